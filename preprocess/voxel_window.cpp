#include "isobrick/preprocess/voxel_window.h"

#include "isobrick/preprocess/kernels/tile_ranges.h"
#include "isobrick/preprocess/pyramid_file_builder.h"

namespace isobrick {

PyramidSpec level0Spec(const VolumeInfo& info) {
  BuildOptions options;
  options.with_curvature = false;
  return pyramidSpecOf(info, options);
}

template <typename T>
ValueRange VoxelWindow<T>::seenRange() const {
  const std::lock_guard lock(mutex_);
  return seen_;
}

template <typename T>
ValueRange VoxelWindow<T>::range(const Index3& brick) const {
  const IndexBox cells = layout_.brickCellBox(0, brick);
  const ValueRange range = rangeOfBlock(voxels_.part({cells.first, cells.count + Index3(1)}));
  const std::lock_guard lock(mutex_);
  seen_.include(range);
  return range;
}

template <typename T>
void VoxelWindow<T>::copyTileRanges(const Index3& brick, std::byte* out) const {
  thread_local CubeRanges<T> tiles;
  tiles.reset(layout_.brickTiles(0, brick));
  includeClosedCubes(voxels_, layout_.brickCellBox(0, brick), layout_.tileCells(), tiles);
  T* pair = reinterpret_cast<T*>(out);
  for (std::size_t i = 0; i < tiles.size(); ++i) {
    *pair++ = tiles.min[i];
    *pair++ = tiles.max[i];
  }
}

template <typename T>
void VoxelWindow<T>::copySamples(const Index3& brick, std::byte* out) const {
  const IndexBox box = layout_.brickSampleBox(0, brick);
  copyBox(voxels_, box, reinterpret_cast<T*>(out), box);
}

#define ISOBRICK_INSTANTIATE(T) template class VoxelWindow<T>;
ISOBRICK_FOR_EACH_VOXEL_TYPE(ISOBRICK_INSTANTIATE)
#undef ISOBRICK_INSTANTIATE

}  // namespace isobrick
