#include "isobrick/preprocess/volume_source.h"

#include <algorithm>
#include <cstddef>
#include <stdexcept>

namespace isobrick {

void VolumeSource::readRows(std::int64_t first, std::int64_t count, void* out) {
  auto* to = static_cast<std::byte*>(out);
  const Index3& voxels = info().voxels;
  while (count > 0) {
    const std::int64_t y = first % voxels.y, z = first / voxels.y;
    const bool is_whole = y == 0 && count >= voxels.y;
    const std::int64_t slices = is_whole ? count / voxels.y : 1;
    const std::int64_t rows = is_whole ? voxels.y : std::min(voxels.y - y, count);
    const IndexBox box{Index3(0, y, z), Index3(voxels.x, rows, slices)};
    readBox(box, to);
    to += static_cast<std::size_t>(box.size()) * voxelBytes(info().voxel_type);
    first += rows * slices;
    count -= rows * slices;
  }
}

void VolumeSource::announce(std::span<const IndexBox>) const {}

void VolumeSource::chooseVoxels(const CancelFlag*, const std::function<void(double)>&) {}
void VolumeSource::chooseVoxelsAs(const VolumeInfo&) {}

void VolumeSource::readBox(const IndexBox&, void*) const {
  throw std::logic_error("this volume source is read by rows; ask readsBoxes() first");
}

}  // namespace isobrick
