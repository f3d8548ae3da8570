#include "isobrick/preprocess/voxel_array.h"

#include "isobrick/preprocess/finite_voxels.h"
#include "isobrick/preprocess/voxel_window.h"
#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/isolated_loop.h"

namespace isobrick {
namespace {

template <typename T>
std::unique_ptr<const Pyramid> pyramidOf(const VolumeInfo& info, const VoxelArray& array) {
  const PyramidSpec spec = level0Spec(info);
  const SampleBlock<T> voxels{static_cast<const T*>(array.first),
                              {Index3(0), info.voxels},
                              array.row_stride,
                              array.slice_stride};
  const BrickLayout layout = spec.layout();
  const auto window = std::make_shared<VoxelWindow<T>>(layout);
  window->show(voxels);
  ValueRange values = rangeOfType<T>();
  if constexpr (std::is_same_v<T, float>) {
    isolatedForEach(std::int64_t{0}, elementCount(layout.bricks(0)), [&](std::int64_t i) {
      const Index3 brick = indexAt(i, layout.bricks(0));
      requireFinite(voxels.part(layout.brickOwnSamples(0, brick)), info);
      static_cast<void>(window->range(brick));
    });
    values = window->seenRange();
  }
  return std::make_unique<const Pyramid>(info.source, spec, values, window);
}

}  // namespace

std::unique_ptr<const Pyramid> pyramidOfArray(const VolumeInfo& info, const VoxelArray& array) {
  std::unique_ptr<const Pyramid> pyramid;
  visitVoxelType(info.voxel_type,
                 [&](auto tag) { pyramid = pyramidOf<typename decltype(tag)::Type>(info, array); });
  return pyramid;
}

}  // namespace isobrick
