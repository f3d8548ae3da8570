// Cells of level 1 whose error is beyond a tolerance, a brick at a time (rule 15).
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "isobrick/extract/active_tiles.h"
#include "isobrick/extract/kernels/error_flags.h"
#include "isobrick/extract/mesh_context.h"
#include "isobrick/extract/row_bits.h"

namespace isobrick {

// A bit for each cell of a box, in rows of words along x.
class CellBits {
 public:
  CellBits() = default;
  explicit CellBits(const IndexBox& box)
      : box_(box),
        words_(wordsOf(box.count.x)),
        bits_(static_cast<std::size_t>(words_ * box.count.y * box.count.z)) {}

  const IndexBox& box() const { return box_; }
  std::int64_t words() const { return words_; }  // a row
  // Cell (box().first.x + i, y, z) in bit i % 64 of word i / 64.
  std::uint64_t* row(std::int64_t y, std::int64_t z) { return bits_.data() + offset(y, z); }
  const std::uint64_t* row(std::int64_t y, std::int64_t z) const {
    return bits_.data() + offset(y, z);
  }
  bool has(const Index3& cell) const {
    const std::int64_t i = cell.x - box_.first.x;
    return (row(cell.y, cell.z)[i / 64] >> i % 64 & 1) != 0;
  }

 private:
  std::int64_t offset(std::int64_t y, std::int64_t z) const {
    return ((z - box_.first.z) * box_.count.y + y - box_.first.y) * words_;
  }

  IndexBox box_;
  std::int64_t words_ = 0;
  std::vector<std::uint64_t> bits_;
};

// The cells of level 1 in a brick of level 0.
inline IndexBox coarseCellsOf(const BrickLayout& layout, const Index3& brick) {
  return parentsOf(layout.brickCellBox(0, brick));
}

// Finds the cells; keeps its memory from brick to brick. One object serves one thread.
//
// A leaf of level 1 has at each corner the sample of level 1, or that of level 0 where a leaf of
// level 0 touches it; a leaf of level 0 has at corners that hang on the former the mean of the two
// or four ends. Which of them it is depends on what is refined around. So the field of the coarse
// leaf is taken to lie anywhere between the interpolants of the lesser and of the greater of the
// two samples, and a cell is beyond the tolerance if for any field there
//
//   - a crossing on an edge of level 0 in the closed cell lies where level 0 is beyond it,
//   - or a voxel in the closed cell that is beyond it comes to the wrong side,
//   - or a crossing on an edge of level 0 that leads away from the cell, with the end that the cell
//     has hanging on it and the other end its own voxel, lies where level 0 is beyond it. (Where
//     the other end hangs too, it hangs on a leaf that has the whole edge.)
class ErrorCells {
 public:
  // Of the cells of the brick and of a ring around them: those that an edge or voxel of the brick's
  // closed box brings beyond the tolerance. What a ring cell has from other bricks is missing. An
  // empty box where there are none, which is so of bricks without an active tile; their samples are
  // not asked for.
  //
  // Only cells for which wants(cell of level 2 around it) holds, and holds for all cells of level 2
  // that touch the cell, are asked for: of others something may be missing.
  CellBits find(const MeshContext& context, const Index3& brick, const ErrorBound& bound,
                const std::function<bool(const Index3&)>& wants);

 private:
  // Voxels of a row, both ends included.
  struct VoxelRun {
    std::int64_t first, last;

    std::int64_t count() const { return last - first + 1; }
  };

  ActiveTiles tiles_;
  std::vector<VoxelRun> runs_, row_runs_;
  // Of two planes of voxels in turn: values and bounds, row by row.
  std::vector<float> planes_[2];
  std::vector<std::uint8_t> is_filled_[2];
  std::vector<std::uint8_t> flags_;
  std::vector<std::uint8_t> cells_;  // of the box with the ring, x fastest; 1: beyond
  template <typename T>
  class Brick;
};

}  // namespace isobrick
