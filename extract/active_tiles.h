// The tiles of a brick that the isosurface may cross.
#pragma once

#include <vector>

#include "isobrick/extract/mesh_context.h"

namespace isobrick {

// Filled by load(); keeps its memory from brick to brick.
class ActiveTiles {
 public:
  // Asks for the brick's tile ranges unless culling is off. Returns false where no tile is active.
  bool load(const MeshContext& context, int level, const Index3& brick) {
    dims_ = context.pyramid.layout().brickTiles(level, brick);
    const auto count = static_cast<std::size_t>(elementCount(dims_));
    active_.assign(count, 1);
    if (!context.query.cull_by_ranges) return true;
    context.tileRanges(level, brick, ranges_);
    bool any = false;
    for (std::size_t i = 0; i < count; ++i) {
      active_[i] = ranges_[i].crosses(context.isovalue) ? 1 : 0;
      any = any || active_[i] != 0;
    }
    return any;
  }

  const Index3& dims() const { return dims_; }
  bool isActive(const Index3& tile) const {
    return active_[static_cast<std::size_t>(linearIndex(tile, dims_))] != 0;
  }

 private:
  Index3 dims_{0};
  std::vector<ValueRange> ranges_;
  std::vector<std::uint8_t> active_;
};

}  // namespace isobrick
