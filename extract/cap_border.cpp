#include "isobrick/extract/cap_border.h"

#include <algorithm>

#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/pyramid_parts.h"

namespace isobrick {

CapBorder::CapBorder(const Lattice& lattice, const SurfaceChoice& choice)
    : is_on_(choice.cap),
      is_below_(choice.inside == InsideOf::kBelow),
      low_(0),
      high_(lattice.voxels() - Index3(1)) {
  if (!choice.box) return;
  const glm::dvec3 last(high_);
  low_ = Index3(glm::clamp(choice.box->min, glm::dvec3(0.0), last));
  high_ = Index3(glm::clamp(choice.box->max, glm::dvec3(0.0), last));
}

unsigned CapBorder::facesOf(const Lattice& lattice, int level, const IndexBox& cells) const {
  if (!is_on_) return 0;
  const Index3 first = lattice.position(level, cells.first);
  const Index3 end = lattice.position(level, cells.end());
  unsigned faces = 0;
  for (int axis = 0; axis < 3; ++axis) {
    if (first[axis] <= low_[axis]) faces |= 1u << (2 * axis);
    if (end[axis] >= high_[axis]) faces |= 2u << (2 * axis);
  }
  return faces;
}

bool CapBorder::reachesBrick(const Pyramid& pyramid, int level, const Index3& brick,
                             float isovalue) const {
  const ValueRange range = pyramid.brickRange(level, brick);
  return range.crosses(isovalue) ||
         (is_on_ && mayBeInside(range, isovalue) &&
          facesOf(pyramid.lattice(), level, pyramid.layout().brickCellBox(level, brick)) != 0);
}

void CapBorder::findTiles(const Pyramid& pyramid, int level, const Index3& brick, float isovalue,
                          std::vector<std::uint8_t>& out, const CancelFlag* cancel) const {
  pyramid.parts().crossedTiles(level, brick, isovalue, out, cancel);
  const BrickLayout& layout = pyramid.layout();
  const IndexBox cells = layout.brickCellBox(level, brick);
  if (facesOf(pyramid.lattice(), level, cells) == 0) return;
  std::vector<ValueRange> ranges;
  pyramid.tileRanges(level, brick, ranges, cancel);
  const Index3 tiles = layout.brickTiles(level, brick);
  forEachIndex({Index3(0), tiles}, [&](const Index3& tile) {
    const auto number = static_cast<std::size_t>(linearIndex(tile, tiles));
    if (out[number] != 0 || !mayBeInside(ranges[number], isovalue)) return;
    const Index3 first = cells.first + layout.tileCells() * tile;
    const Index3 end = glm::min(first + Index3(layout.tileCells()), cells.end());
    if (facesOf(pyramid.lattice(), level, {first, end - first}) != 0) out[number] = 1;
  });
}

}  // namespace isobrick
