#include <filesystem>

#include "isobrick/preprocess/export/atomic_folder.h"
#include "isobrick/preprocess/export/formats/format_writers.h"
#include "isobrick/preprocess/export/volume_rows.h"
#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"

namespace isobrick {

namespace fs = std::filesystem;

bool isSlicePattern(const std::string& path) {
  return fs::path(path).filename().string().find('%') != std::string::npos;
}

void refuseLargeSlices(const VolumeInfo& info, const std::string& path,
                       const ExportOptions& options) {
  const std::uint64_t slice_bytes = rowBytes(info) * static_cast<std::uint64_t>(info.voxels.y);
  if (slice_bytes > options.memory_bytes)
    throw unwritable(path, "a slice takes " + std::to_string((slice_bytes >> 20) + 1) + " MiB",
                     {Remedy::kAllowMoreMemory});
}

void forEachSlice(VolumeSource& source, const ExportOptions& options,
                  const std::function<void(std::int64_t slice, const std::byte* data)>& take) {
  const VolumeInfo& info = source.info();
  const std::uint64_t slice_bytes = rowBytes(info) * static_cast<std::uint64_t>(info.voxels.y);
  forEachRun(source, options, [&](std::int64_t row, std::int64_t rows, const std::byte* data) {
    for (std::int64_t end = row + rows; row < end; row += info.voxels.y, data += slice_bytes) {
      checkCancel(options);
      take(row / info.voxels.y, data);
    }
  });
}

VolumeWriteReport writeSlices(
    VolumeLevels& levels, const std::string& pattern, const ExportOptions& options,
    const std::function<void(const std::string& path, const std::byte* slice)>& write) {
  const std::optional<NumberedFiles> files = parseNumberedFiles(pattern);
  if (!files)
    throw unwritable(pattern,
                     "slices go into a folder of their own, and their name has one place for the "
                     "number; write as folder/%04d" +
                         fs::path(pattern).extension().string());
  refuseLargeSlices(levels.front()->info(), pattern, options);
  AtomicFolder folder(files->folder);
  VolumeWriteReport report;
  forEachSlice(*levels.front(), options, [&](std::int64_t slice, const std::byte* data) {
    const std::string file = folder.temporaryPath() + "/" + files->name.of(slice);
    write(file, data);
    report.bytes += fileBytes(file);
  });
  if (options.before_publishing) options.before_publishing();
  folder.commit(options.cancel);
  return report;
}

}  // namespace isobrick
