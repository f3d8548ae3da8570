// Bricks of level 0 made from voxels that are in memory.
#pragma once

#include <limits>
#include <mutex>

#include "isobrick/preprocess/kernels/sample_block.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/brick_supply.h"
#include "isobrick/storage/pyramid_info.h"

namespace isobrick {

// Of a volume of which no pyramid is built: as a pyramid has it by default, without curvature.
PyramidSpec level0Spec(const VolumeInfo& info);

// All values that a voxel of the type may have, which bounds those of integers: normals are the
// same whatever the bounds, as long as squares of gradients fit floats. Floats need their own.
template <typename T>
constexpr ValueRange rangeOfType() {
  return {static_cast<float>(std::numeric_limits<T>::lowest()),
          static_cast<float>(std::numeric_limits<T>::max())};
}

// The bricks of a box of voxels, which changes: those that are at hand. T is the voxel type.
template <typename T>
class VoxelWindow final : public BrickSupply {
 public:
  explicit VoxelWindow(const BrickLayout& layout) : layout_(layout) {}

  // From now on the bricks are at hand whose sample boxes lie in `voxels`, which outlive their use.
  // Nobody may use the former bricks any more.
  void show(const SampleBlock<T>& voxels) { voxels_ = voxels; }
  // The range of all bricks that were asked for theirs.
  ValueRange seenRange() const;

  ValueRange range(const Index3& brick) const override;
  void copyTileRanges(const Index3& brick, std::byte* out) const override;
  void copySamples(const Index3& brick, std::byte* out) const override;

 private:
  const BrickLayout layout_;
  SampleBlock<T> voxels_;
  mutable std::mutex mutex_;  // guards all below
  mutable ValueRange seen_;
};

}  // namespace isobrick
