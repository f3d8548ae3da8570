#include "isobrick/preprocess/export/formats/slice_writers.h"

#include <algorithm>
#include <filesystem>
#include <vector>

#include "isobrick/preprocess/export/atomic_folder.h"
#include "isobrick/preprocess/export/volume_rows.h"
#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

// The parts of "slice%04d.exr" around the number, and its least digits.
struct SliceName {
  std::string before, after;
  int digits = 0;
  bool is_good = false;

  std::string of(std::int64_t slice) const {
    const std::string number = std::to_string(slice);
    const auto width = static_cast<std::size_t>(digits);
    return before + std::string(width - std::min(width, number.size()), '0') + number + after;
  }
};

SliceName parsePattern(const std::string& name) {
  SliceName result;
  const std::size_t percent = name.find('%');
  if (percent == std::string::npos) return result;
  std::size_t at = percent + 1;
  for (; at < name.size() && name[at] >= '0' && name[at] <= '9' && at < percent + 4; ++at)
    result.digits = 10 * result.digits + (name[at] - '0');
  if (at >= name.size() || name[at] != 'd' || result.digits > 18 ||
      name.find('%', at) != std::string::npos)
    return result;
  result.before = name.substr(0, percent);
  result.after = name.substr(at + 1);
  result.is_good = true;
  return result;
}

}  // namespace

bool isSlicePattern(const std::string& path) {
  return fs::path(path).filename().string().find('%') != std::string::npos;
}

void refuseLargeSlices(const VolumeInfo& info, const std::string& path,
                       const ExportOptions& options) {
  const std::uint64_t slice_bytes = rowBytes(info) * static_cast<std::uint64_t>(info.voxels.y);
  if (slice_bytes > options.memory_bytes)
    throw Error("cannot write '" + path + "': a slice takes " +
                    std::to_string((slice_bytes >> 20) + 1) + " MiB",
                {.path = path}, {Remedy::kAllowMoreMemory});
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
  const fs::path path(pattern);
  const SliceName name = parsePattern(path.filename().string());
  const std::string folder_name = path.parent_path().string();
  if (!name.is_good || folder_name.empty() || folder_name.find('%') != std::string::npos)
    throw Error("cannot write '" + pattern + "': slices go into a folder of their own, and their " +
                    "name has one place for the number; write as folder/%04d" +
                    path.extension().string(),
                {.path = pattern});
  refuseLargeSlices(levels.front()->info(), pattern, options);
  AtomicFolder folder(folder_name);
  VolumeWriteReport report;
  forEachSlice(*levels.front(), options, [&](std::int64_t slice, const std::byte* data) {
    const std::string file = folder.temporaryPath() + "/" + name.of(slice);
    write(file, data);
    report.bytes += fs::file_size(file);
  });
  if (options.before_publishing) options.before_publishing();
  folder.commit(options.cancel);
  return report;
}

}  // namespace isobrick
