// Bricks of level 0 made from voxels that are in memory.
#pragma once

#include <vector>

#include "isobrick/preprocess/kernels/sample_block.h"
#include "isobrick/preprocess/kernels/tile_ranges.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/brick_supply.h"
#include "isobrick/storage/pyramid_info.h"

namespace isobrick {

// Of a volume of which no pyramid is built: as a pyramid has it by default, without curvature.
PyramidSpec level0Spec(const VolumeInfo& info);

// The bricks of a box of voxels, which changes: those that are at hand. T is the voxel type.
template <typename T>
class VoxelWindow final : public BrickSupply {
 public:
  explicit VoxelWindow(const BrickLayout& layout) : layout_(layout) {}

  // From now on these bricks are at hand, of `voxels`, which have at least their sample boxes and
  // outlive their use. Finds the ranges of tiles, on the calling TBB arena. Nobody may use the
  // former bricks any more.
  void show(const IndexBox& bricks, const SampleBlock<T>& voxels);
  // The range of all bricks that were shown.
  const ValueRange& shownRange() const { return shown_range_; }

  ValueRange range(const Index3& brick) const override { return bricks_[place(brick)].range; }
  const std::byte* tileRanges(const Index3& brick) const override {
    return reinterpret_cast<const std::byte*>(bricks_[place(brick)].pairs.data());
  }
  void copySamples(const Index3& brick, std::byte* out) const override;

 private:
  struct Brick {
    CubeRanges<T> tiles;
    std::vector<T> pairs;
    ValueRange range;
  };
  std::size_t place(const Index3& brick) const {
    return static_cast<std::size_t>(linearIndex(brick - box_.first, box_.count));
  }
  void findRanges(const Index3& brick, Brick& out) const;

  const BrickLayout layout_;
  IndexBox box_;  // of bricks at hand
  SampleBlock<T> voxels_;
  std::vector<Brick> bricks_;  // at least those, x fastest
  ValueRange shown_range_;
};

}  // namespace isobrick
