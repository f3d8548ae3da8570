#include "isobrick/preprocess/brick_window.h"

#include <algorithm>
#include <bit>

#include "isobrick/preprocess/kernels/low_pass.h"
#include "isobrick/storage/index_loop.h"

namespace isobrick {

BrickNeeds::BrickNeeds(const PyramidSpec& spec)
    : spec_(spec),
      layout_(spec.layout()),
      tile_levels_(std::countr_zero(static_cast<std::uint64_t>(spec.tile_cells))) {}

int BrickNeeds::levelsAbove(int level) const {
  return std::min(tile_levels_, layout_.lattice().levels() - 1 - level);
}

IndexBox BrickNeeds::cellsAbove(int level, const IndexBox& bricks, int above) const {
  const std::int64_t brick = spec_.brick_cells;
  const Index3 first = bricks.first * brick;
  const Index3 end = glm::min(bricks.end() * brick, layout_.lattice().cells(level));
  const std::int64_t step = std::int64_t{1} << above;
  const Index3 coarse_first = first / step;
  return {coarse_first, BrickLayout::ceilDivide(end, step) - coarse_first};
}

IndexBox BrickNeeds::samplesAbove(int level, const IndexBox& bricks, int above) const {
  const int top = levelsAbove(level);
  const auto corners = [&](int at) {
    const IndexBox cells = cellsAbove(level, bricks, at);
    return IndexBox{cells.first, cells.count + Index3(1)};
  };
  IndexBox box = corners(top);
  for (int at = top - 1; at >= above; --at)
    box = unionOf(corners(at), lowPassSupport(layout_.lattice(), level + at, spec_.filter, box));
  return box;
}

IndexBox BrickNeeds::samples(int level, const IndexBox& bricks) const {
  const IndexBox first = layout_.brickSampleBox(level, bricks.first);
  const IndexBox last = layout_.brickSampleBox(level, bricks.end() - Index3(1));
  return unionOf(unionOf(first, last), samplesAbove(level, bricks, 0));
}

IndexBox BrickNeeds::handedOn(int level, const IndexBox& bricks) const {
  const std::int64_t half = spec_.brick_cells / 2;
  const Index3 first = bricks.first * half;
  Index3 end = bricks.end() * half;
  // The last brick of an axis has the level's last sample too.
  for (int axis = 0; axis < 3; ++axis)
    if (bricks.end()[axis] == layout_.bricks(level)[axis])
      end[axis] = layout_.lattice().samples(level + 1)[axis];
  return {first, end - first};
}

// A brick's first samples are the last ones of its neighbour.
IndexBox BrickNeeds::ownVoxels(const IndexBox& bricks) const {
  const Index3 first = bricks.first * spec_.brick_cells + glm::min(bricks.first, Index3(1));
  return {first, glm::min(bricks.end() * spec_.brick_cells + Index3(1), spec_.voxels) - first};
}

// Axes do not depend on each other. Along one, windows differ only near the volume's ends: the part
// of a window beyond its bricks is less than a brick, so it reaches at most into the last but one
// of the windows before an end that is cut off.
template <typename F>
Index3 BrickNeeds::greatest(const IndexBox& all, const Index3& per_window, F&& box_of) {
  constexpr std::int64_t kEnds = 3;
  Index3 most(0);
  for (int axis = 0; axis < 3; ++axis) {
    const std::int64_t windows = (all.count[axis] + per_window[axis] - 1) / per_window[axis];
    for (std::int64_t i = 0; i < windows; ++i) {
      if (i == kEnds) i = std::max(i, windows - kEnds);
      IndexBox bricks{all.first, Index3(1)};
      bricks.first[axis] += i * per_window[axis];
      bricks.count[axis] = std::min(per_window[axis], all.end()[axis] - bricks.first[axis]);
      most[axis] = std::max(most[axis], box_of(bricks).count[axis]);
    }
  }
  return most;
}

Index3 BrickNeeds::greatestSamples(int level, const IndexBox& all, const Index3& per_window) const {
  return greatest(all, per_window, [&](const IndexBox& bricks) { return samples(level, bricks); });
}

Index3 BrickNeeds::greatestHandedOn(int level, const IndexBox& all,
                                    const Index3& per_window) const {
  return greatest(all, per_window, [&](const IndexBox& bricks) { return handedOn(level, bricks); });
}

IndexBox BrickNeeds::tiles(int level, const IndexBox& bricks) const {
  const std::int64_t per_brick = spec_.brick_cells / spec_.tile_cells;
  const Index3 first = bricks.first * per_brick;
  return {first, glm::min(bricks.end() * per_brick, allTiles(level)) - first};
}

Index3 BrickNeeds::allTiles(int level) const {
  return BrickLayout::ceilDivide(layout_.lattice().cells(level), spec_.tile_cells);
}

}  // namespace isobrick
