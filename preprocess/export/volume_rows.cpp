#include "isobrick/preprocess/export/volume_rows.h"

namespace isobrick {
namespace {

// A request to cancel is checked after so many bytes: some milliseconds for any source.
constexpr std::uint64_t kBytesPerLook = std::uint64_t{1} << 20;

// The slices of a layer of a pyramid's bricks, unless it was built otherwise.
constexpr std::int64_t kBrickSlices = 64;

}  // namespace

void readRowsWatched(VolumeSource& source, std::int64_t first, std::int64_t count, std::byte* out,
                     const VolumeWriteOptions& options) {
  const VolumeInfo& info = source.info();
  const std::uint64_t row_bytes = rowBytes(info);
  // Sources of boxes check the request themselves, and are fast; those read in order may be slow.
  const std::int64_t per_look =
      source.readsBoxes()
          ? count
          : std::max(std::int64_t{1}, static_cast<std::int64_t>(kBytesPerLook / row_bytes));
  for (std::int64_t done = 0; done < count;) {
    checkCancel(options);
    const std::int64_t rows = std::min(per_look, count - done);
    source.readRows(first + done, rows, out + static_cast<std::uint64_t>(done) * row_bytes);
    done += rows;
  }
  checkCancel(options);
}

std::int64_t slicesInMemory(const VolumeInfo& info, std::uint64_t bytes) {
  const std::uint64_t slice_bytes = rowBytes(info) * static_cast<std::uint64_t>(info.voxels.y);
  const auto fit = std::min(static_cast<std::int64_t>(bytes / slice_bytes), info.voxels.z);
  // More than a few layers would only make progress and Ctrl-C slower.
  if (fit >= kBrickSlices) return kBrickSlices;
  return fit;
}

}  // namespace isobrick
