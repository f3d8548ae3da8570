// Rows of sources that read boxes.
#pragma once

#include <algorithm>

#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// VolumeSource::readRows() by readBox(): as many whole slices at once as there are, so that every
// brick or chunk of them is read once.
inline void readRowsAsBoxes(const VolumeSource& source, std::int64_t first, std::int64_t count,
                            void* out) {
  auto* to = static_cast<std::byte*>(out);
  const Index3& voxels = source.info().voxels;
  while (count > 0) {
    const std::int64_t y = first % voxels.y, z = first / voxels.y;
    const bool is_whole = y == 0 && count >= voxels.y;
    const std::int64_t slices = is_whole ? count / voxels.y : 1;
    const std::int64_t rows = is_whole ? voxels.y : std::min(voxels.y - y, count);
    const IndexBox box{Index3(0, y, z), Index3(voxels.x, rows, slices)};
    source.readBox(box, to);
    to += static_cast<std::size_t>(box.size()) * voxelBytes(source.info().voxel_type);
    first += rows * slices;
    count -= rows * slices;
  }
}

}  // namespace isobrick
