// A volume's rows in order, a bounded run of them at a time: the input of all writers. Private to
// preprocess/export/.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "isobrick/preprocess/export/volume_writer.h"
#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// Bytes of one row as the source delivers it.
inline std::uint64_t rowBytes(const VolumeInfo& info) {
  return static_cast<std::uint64_t>(info.voxels.x) * voxelBytes(info.voxel_type);
}

// The source's voxels as bytes: of level 0, the only one that most formats have.
inline std::uint64_t volumeBytes(const VolumeInfo& info) {
  return static_cast<std::uint64_t>(elementCount(info.voxels)) * voxelBytes(info.voxel_type);
}

inline void checkCancel(const VolumeWriteOptions& options) {
  if (options.cancel != nullptr) options.cancel->check();
}

// Gives a complete file or folder its name.
template <typename Output>
void publish(Output& output, const VolumeWriteOptions& options) {
  if (options.before_publishing) options.before_publishing();
  output.commit(options.cancel);
}

// Fills `out` with rows, and checks the request to cancel after every MiB if the source is slow.
void readRowsWatched(VolumeSource& source, std::int64_t first, std::int64_t count, std::byte* out,
                     const VolumeWriteOptions& options);

// Slices that a run of at most `bytes` has: as many layers of bricks as fit, so that a pyramid's
// brick is unpacked once, or as many slices; 0 if not even one fits.
std::int64_t slicesInMemory(const VolumeInfo& info, std::uint64_t bytes);

// Calls take(first row, rows, bytes) with all rows in order: whole slices if one fits into
// options.memory_bytes, otherwise as many rows as fit, and at least one. Tells progress.
template <typename Take>
void forEachRun(VolumeSource& source, const VolumeWriteOptions& options, Take&& take) {
  const VolumeInfo& info = source.info();
  const std::int64_t all_rows = info.voxels.y * info.voxels.z;
  const std::int64_t slices = slicesInMemory(info, options.memory_bytes);
  const std::int64_t most =
      slices > 0 ? std::min(slices * info.voxels.y, all_rows)
                 : std::clamp(static_cast<std::int64_t>(options.memory_bytes / rowBytes(info)),
                              std::int64_t{1}, info.voxels.y);
  std::vector<std::byte> run(static_cast<std::size_t>(most) * rowBytes(info));
  for (std::int64_t row = 0; row < all_rows;) {
    const std::int64_t in_slice = info.voxels.y - row % info.voxels.y;
    const std::int64_t rows = std::min({most, all_rows - row, slices > 0 ? most : in_slice});
    readRowsWatched(source, row, rows, run.data(), options);
    take(row, rows, static_cast<const std::byte*>(run.data()));
    row += rows;
    if (options.progress)
      options.progress(static_cast<double>(row) / static_cast<double>(all_rows));
  }
}

}  // namespace isobrick
