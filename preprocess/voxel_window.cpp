#include "isobrick/preprocess/voxel_window.h"

#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/isolated_loop.h"

namespace isobrick {

PyramidSpec level0Spec(const VolumeInfo& info) {
  PyramidSpec spec;
  spec.voxels = info.voxels;
  spec.voxel_type = info.voxel_type;
  spec.geometry = info.geometry;
  spec.values = info.values;
  spec.has_curvature = false;
  return spec;
}

template <typename T>
void VoxelWindow<T>::show(const IndexBox& bricks, const SampleBlock<T>& voxels) {
  box_ = bricks;
  voxels_ = voxels;
  const auto count = static_cast<std::size_t>(bricks.size());
  if (bricks_.size() < count) bricks_.resize(count);
  isolatedForEach(std::size_t{0}, count, [&](std::size_t i) {
    findRanges(bricks.first + indexAt(static_cast<std::int64_t>(i), bricks.count), bricks_[i]);
  });
  for (std::size_t i = 0; i < count; ++i) shown_range_.include(bricks_[i].range);
}

template <typename T>
void VoxelWindow<T>::findRanges(const Index3& brick, Brick& out) const {
  out.tiles.reset(layout_.brickTiles(0, brick));
  includeClosedCubes(voxels_, layout_.brickCellBox(0, brick), layout_.tileCells(), out.tiles);
  out.pairs.resize(2 * out.tiles.size());
  out.range = {};
  for (std::size_t i = 0; i < out.tiles.size(); ++i) {
    out.pairs[2 * i] = out.tiles.min[i];
    out.pairs[2 * i + 1] = out.tiles.max[i];
    out.range.include(out.tiles.range(i));
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
