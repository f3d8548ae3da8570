// How the levels of a pyramid are cut into bricks, and bricks into tiles and blocks.
#pragma once

#include <algorithm>
#include <string>

#include "isobrick/storage/grid.h"

namespace isobrick {

// A half-open box of indices [first, first + count) per axis; of samples, cells, bricks or tiles.
struct IndexBox {
  Index3 first{0};  // the least index
  Index3 count{0};  // how many, per axis

  bool operator==(const IndexBox&) const = default;
  // One past the greatest index, per axis.
  Index3 end() const { return first + count; }
  // How many indices.
  std::int64_t size() const { return elementCount(count); }
};

// Pure arithmetic on a lattice and two edge lengths in cells; nothing here touches a file.
//
// A brick of level l covers brick_cells^3 cells of that level (fewer at the far border) and stores
// every sample that meshing those cells needs: their corners and one more sample on each side for
// central differences, as far as the volume reaches. A tile is tile_cells^3 cells of a brick: the
// smallest block that has a value range. Tiles of level 0 form blocks that have a curvature bound.
class BrickLayout {
 public:
  BrickLayout() = default;
  // Both edges are powers of two; a tile's is at most a brick's.
  BrickLayout(const Lattice& lattice, std::int64_t brick_cells, std::int64_t tile_cells)
      : lattice_(lattice), brick_cells_(brick_cells), tile_cells_(tile_cells) {}

  // The samples' places.
  const Lattice& lattice() const { return lattice_; }
  // Cells along an edge of a brick.
  std::int64_t brickCells() const { return brick_cells_; }
  // Cells along an edge of a tile.
  std::int64_t tileCells() const { return tile_cells_; }

  // Bricks of a level, per axis.
  Index3 bricks(int level) const { return ceilDivide(lattice_.cells(level), brick_cells_); }

  // Cells of `level` that the brick covers.
  IndexBox brickCellBox(int level, const Index3& brick) const {
    const Index3 first = brick * brick_cells_;
    return {first, glm::min(Index3(brick_cells_), lattice_.cells(level) - first)};
  }
  // Samples of `level` that the brick stores: the cells' corners and an apron of one.
  IndexBox brickSampleBox(int level, const Index3& brick) const {
    const IndexBox cells = brickCellBox(level, brick);
    const Index3 first = glm::max(cells.first - Index3(1), Index3(0));
    const Index3 last = glm::min(cells.end() + Index3(1), lattice_.samples(level) - Index3(1));
    return {first, last - first + Index3(1)};
  }
  // The stored samples that belong to this brick alone: those at the cells' lower corners and, at
  // the far border, the last ones too.
  IndexBox brickOwnSamples(int level, const Index3& brick) const {
    IndexBox own = brickCellBox(level, brick);
    for (int axis = 0; axis < 3; ++axis)
      if (own.end()[axis] == lattice_.cells(level)[axis]) ++own.count[axis];
    return own;
  }
  // Tiles per axis inside the brick.
  Index3 brickTiles(int level, const Index3& brick) const {
    return ceilDivide(brickCellBox(level, brick).count, tile_cells_);
  }
  // Cells along an edge of a block that has a curvature bound: whole tiles, 16 cells if the brick
  // has them. Blocks of 8 fit more surfaces, but leaves of level 1 in small groups cost more in
  // fans than they save; small volumes have small shapes.
  std::int64_t curvatureCells() const {
    const Index3 voxels = lattice_.voxels();
    const std::int64_t wanted = std::max({voxels.x, voxels.y, voxels.z}) <= 128 ? 8 : 16;
    return std::max(tile_cells_, std::min(wanted, brick_cells_));
  }
  // Blocks per axis inside a brick of level 0 that have a curvature bound.
  Index3 brickCurvatureBlocks(const Index3& brick) const {
    return ceilDivide(brickCellBox(0, brick).count, curvatureCells());
  }

  // a / b per axis, rounded up.
  static Index3 ceilDivide(const Index3& a, std::int64_t b) { return (a + Index3(b - 1)) / b; }

 private:
  Lattice lattice_;
  std::int64_t brick_cells_ = 64;
  std::int64_t tile_cells_ = 4;
};

// The address of a brick in a pyramid.
struct BrickAddress {
  int level = 0;    // of the brick
  Index3 brick{0};  // its place among the bricks of the level
};

// "brick (1,2,3) of level 0".
inline std::string brickName(int level, const Index3& brick) {
  return "brick (" + std::to_string(brick.x) + "," + std::to_string(brick.y) + "," +
         std::to_string(brick.z) + ") of level " + std::to_string(level);
}

// Position of `index` in a dense block of `dims`, x fastest.
constexpr std::int64_t linearIndex(const Index3& index, const Index3& dims) {
  return (index.z * dims.y + index.y) * dims.x + index.x;
}

}  // namespace isobrick
