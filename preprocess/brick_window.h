// Neighbouring bricks of one level that are read and made together.
#pragma once

#include <cstdint>

#include "isobrick/storage/brick_layout.h"
#include "isobrick/storage/format.h"
#include "isobrick/storage/pyramid_info.h"

namespace isobrick {

// Input and output of making bricks, as boxes of indices. Pure arithmetic.
class BrickNeeds {
 public:
  explicit BrickNeeds(const PyramidSpec& spec);

  const BrickLayout& layout() const { return layout_; }
  // Coarser levels that a tile's range includes: log2(tile_cells), less at the top of the pyramid.
  int levelsAbove(int level) const;

  // Cells of `level` + `above` in the closed cubes of the bricks; their corners are samples.
  IndexBox cellsAbove(int level, const IndexBox& bricks, int above) const;
  // Samples of `level` that the bricks take: those that they store, and those from which all
  // coarser samples in their ranges are made.
  IndexBox samples(int level, const IndexBox& bricks) const;
  // The samples of level + `above` among them, above >= 1.
  IndexBox samplesAbove(int level, const IndexBox& bricks, int above) const;
  // The samples of level + 1 that these bricks, and no others, pass on to the next level.
  IndexBox handedOn(int level, const IndexBox& bricks) const;
  // The voxels of these bricks, of level 0, that no others count.
  IndexBox ownVoxels(const IndexBox& bricks) const;
  // The most samples along each axis that samples() gives for a window of `all` bricks, and that
  // handedOn() gives. `per_window` are those of BrickWindows, and 1 along z. Buffers are so large.
  Index3 greatestSamples(int level, const IndexBox& all, const Index3& per_window) const;
  Index3 greatestHandedOn(int level, const IndexBox& all, const Index3& per_window) const;
  // Tiles of the bricks in the grid of all tiles of the level.
  IndexBox tiles(int level, const IndexBox& bricks) const;
  Index3 allTiles(int level) const;

 private:
  template <typename F>
  static Index3 greatest(const IndexBox& all, const Index3& per_window, F&& box_of);

  PyramidSpec spec_;
  BrickLayout layout_;
  int tile_levels_;
};

// The (min, max) of tiles as elements of a volume, which is twice as wide.
inline IndexBox tilePairs(const IndexBox& tiles) {
  const Index3 pair(2, 1, 1);
  return {tiles.first * pair, tiles.count * pair};
}

// A box of bricks of a level in the order of the brick table, a window at a time: some neighbours
// along x, or whole rows of bricks of one slab.
class BrickWindows {
 public:
  // `per_window`: bricks along x and y; more than one row only if rows are whole.
  BrickWindows(const IndexBox& bricks, std::int64_t per_window_x, std::int64_t per_window_y)
      : bricks_(bricks), x_(per_window_x), y_(per_window_y) {}

  std::int64_t count() const { return along(0) * along(1) * bricks_.count.z; }
  IndexBox window(std::int64_t i) const {
    const Index3 first(i % along(0) * x_, i / along(0) % along(1) * y_, i / (along(0) * along(1)));
    return {bricks_.first + first, glm::min(Index3(x_, y_, 1), bricks_.count - first)};
  }

 private:
  std::int64_t along(int axis) const {
    const std::int64_t size = axis == 0 ? x_ : y_;
    return (bricks_.count[axis] + size - 1) / size;
  }

  IndexBox bricks_;
  std::int64_t x_, y_;
};

}  // namespace isobrick
