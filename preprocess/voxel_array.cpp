#include "isobrick/preprocess/voxel_array.h"

#include "isobrick/preprocess/finite_voxels.h"
#include "isobrick/preprocess/voxel_window.h"
#include "isobrick/storage/isolated_loop.h"

namespace isobrick {
namespace {

template <typename T>
std::unique_ptr<const Pyramid> pyramidOf(const VolumeInfo& info, const VoxelArray& array) {
  const PyramidSpec spec = level0Spec(info);
  const SampleBlock<T> voxels{static_cast<const T*>(array.first), {Index3(0), info.voxels},
                              array.row_stride, array.slice_stride};
  if constexpr (std::is_same_v<T, float>)
    isolatedFor(std::int64_t{0}, info.voxels.z, [&](std::int64_t z) {
      requireFinite(voxels.part({{0, 0, z}, {info.voxels.x, info.voxels.y, 1}}), info);
    });
  const auto window = std::make_shared<VoxelWindow<T>>(spec.layout());
  window->show({Index3(0), spec.layout().bricks(0)}, voxels);
  return std::make_unique<const Pyramid>(info.source, spec, window->shownRange(), window);
}

}  // namespace

std::unique_ptr<const Pyramid> pyramidOfArray(const VolumeInfo& info, const VoxelArray& array) {
  std::unique_ptr<const Pyramid> pyramid;
  visitVoxelType(info.voxel_type, [&](auto tag) {
    pyramid = pyramidOf<typename decltype(tag)::Type>(info, array);
  });
  return pyramid;
}

}  // namespace isobrick
