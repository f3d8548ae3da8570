#include "isobrick/preprocess/scratch_source.h"

#include <algorithm>

#include "isobrick/preprocess/slice_spool.h"

namespace isobrick {

ScratchSource::ScratchSource(const VolumeSource& source, std::int64_t first, std::int64_t end,
                             const std::string& folder)
    : info_(source.info()),
      files_(source.files()),
      identity_(source.identity()),
      voxels_(IndexBox{{0, 0, first}, {info_.voxels.x, info_.voxels.y, end - first}},
              voxelBytes(info_.voxel_type), ScratchVolume::Place::kFile, folder) {}

void ScratchSource::writeRows(std::int64_t first, std::int64_t count, const std::byte* rows) {
  const std::int64_t y = first % info_.voxels.y, z = first / info_.voxels.y;
  const std::int64_t slices = std::max(std::int64_t{1}, count / info_.voxels.y);
  voxels_.write({{0, y, z}, {info_.voxels.x, count / slices, slices}}, rows);
}

std::unique_ptr<ScratchSource> readIntoScratch(VolumeSource& source, std::int64_t first,
                                               std::int64_t end, const std::string& folder,
                                               const CancelFlag* cancel,
                                               const std::function<void(double)>& progress) {
  auto scratch = std::make_unique<ScratchSource>(source, first, end, folder);
  const VolumeInfo& info = source.info();
  const std::int64_t most_rows = SliceSpool::rowsPerRead(info);
  LargeBuffer rows(static_cast<std::size_t>(most_rows * info.voxels.x) *
                   voxelBytes(info.voxel_type));
  for (std::int64_t z = first; z < end; ++z) {
    if (progress) progress(static_cast<double>(z - first) / static_cast<double>(end - first));
    for (std::int64_t y = 0; y < info.voxels.y; y += most_rows) {
      if (cancel != nullptr) cancel->check();
      const std::int64_t count = std::min(most_rows, info.voxels.y - y);
      source.readRows(z * info.voxels.y + y, count, rows.data());
      scratch->writeRows(z * info.voxels.y + y, count, rows.data());
    }
  }
  scratch->finish(source);
  return scratch;
}

}  // namespace isobrick
