#include "isobrick/preprocess/export/formats/export_volume.h"

#include <filesystem>
#include <memory>
#include <string_view>

#include "isobrick/preprocess/export/atomic_folder.h"
#include "isobrick/preprocess/export/formats/format_writers.h"
#include "isobrick/preprocess/export/source_views.h"
#include "isobrick/preprocess/export/volume_rows.h"
#include "isobrick/preprocess/export/volume_writer.h"
#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/scratch_volume.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"

namespace isobrick {
namespace {

using Writer = VolumeWriteReport (*)(VolumeLevels&, const std::string&, const ExportOptions&);

// `write` is null if this isobrick was built without the library.
struct ExportFormat {
  std::string_view ending;
  bool has_levels;
  bool has_all_types;  // false: those that a pyramid holds
  const char* library;
  Writer write;
};

constexpr ExportFormat kFormats[] = {
#if ISOBRICK_WITH_OPENVDB
    {".vdb", true, false, "OpenVDB", writeVdb},
#else
    {".vdb", true, false, "OpenVDB", nullptr},
#endif
#if ISOBRICK_WITH_HDF5
    {".h5", false, true, "HDF5", writeHdf5},
#else
    {".h5", false, true, "HDF5", nullptr},
#endif
#if ISOBRICK_WITH_OPENEXR
    {".exr", false, false, "OpenEXR", writeExrSlices},
#else
    {".exr", false, false, "OpenEXR", nullptr},
#endif
    {".tif", false, true, "libtiff", writeTiff},       {".tiff", false, true, "libtiff", writeTiff},
    {".ome.zarr", true, true, "Blosc", writeOmeZarr},  {".zarr", true, true, "Blosc", writeOmeZarr},
};

// "file.h5:/path" names a dataset of a file.
const ExportFormat* formatOf(const std::string& name) {
  const std::size_t colon = name.rfind(".h5:/");
  const std::string path = colon == std::string::npos ? name : name.substr(0, colon + 3);
  for (const ExportFormat& format : kFormats)
    if (path.ends_with(format.ending)) return &format;
  return nullptr;
}

void refuseLoss(const ValueLoss& loss, const std::string& path, const ExportOptions& options) {
  constexpr double kMostLoss = 1e-3;  // of the range
  if (options.is_lossy || loss.changed() == 0 || loss.mostChange() <= kMostLoss * loss.range())
    return;
  throw fileError(path, "cannot write '", path, "': ", loss.text(),
                  "; choose a format that has float64, such as .nrrd, or allow the loss");
}

}  // namespace

void makeReadBoxes(std::unique_ptr<VolumeSource>& source, const std::string& folder,
                   const VolumeWriteOptions& options) {
  if (!source->readsBoxes())
    source = readIntoScratch(*source, 0, source->info().voxels.z, folder, options.cancel, nullptr);
}

std::vector<WritableFormat> writableFormats() {
  std::vector<WritableFormat> formats;
  for (const std::string& ending : plainVolumeEndings()) formats.push_back({ending, false, true});
  for (const ExportFormat& format : kFormats)
    formats.push_back({std::string(format.ending), format.has_levels, format.write != nullptr});
  return formats;
}

void refuseUnknownExport(const std::string& path, bool has_levels) {
  const ExportFormat* const format = formatOf(path);
  if (format != nullptr && format->write == nullptr)
    throw unwritable(path, "this isobrick was built without ", format->library,
                     "; build it anew with that, or choose another format");
  if (format == nullptr && !isPlainVolumeName(path))
    throw unwritable(
        path,
        "its ending is none of those that are written (.isb, .vdb, .h5, .ome.zarr, .exr, .tif, "
        ".nrrd, .mhd, .mha, .nii, .nii.gz, .vti, .raw); choose one of them");
  if (has_levels && (format == nullptr || !format->has_levels))
    throw fileError(path, "cannot write all levels to '", path,
                    "': this format has one; choose one of them, or write .vdb or .ome.zarr");
}

VolumeWriteReport exportVolume(VolumeLevels& levels, const std::string& path,
                               const ExportOptions& options) {
  refuseUnknownExport(path, levels.size() > 1);
  const ExportFormat* const format = formatOf(path);
  const auto loss = std::make_shared<ValueLoss>();
  for (auto& level : levels)
    level = makeRealSource(std::move(level), format == nullptr || format->has_all_types, loss);
  ExportOptions checked = options;
  checked.before_publishing = [&] {
    refuseLoss(*loss, path, options);
    if (options.before_publishing) options.before_publishing();
  };
  VolumeWriteReport report = format != nullptr ? format->write(levels, path, checked)
                                               : writeVolume(*levels.front(), path, checked);
  if (loss->changed() > 0) report.lost.push_back(loss->text());
  return report;
}

bool isSlicePattern(const std::string& path) {
  return std::filesystem::path(path).filename().string().find('%') != std::string::npos;
}

void refuseLargeSlices(const VolumeInfo& info, const std::string& path,
                       const ExportOptions& options) {
  const std::uint64_t slice_bytes = rowBytes(info) * static_cast<std::uint64_t>(info.voxels.y);
  if (slice_bytes > options.memory_bytes)
    throw unwritable(path, "a slice takes ", (slice_bytes >> 20) + 1, " MiB",
                     Remedy::kAllowMoreMemory);
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
                     "number; write as folder/%04d",
                     std::filesystem::path(pattern).extension().string());
  refuseLargeSlices(levels.front()->info(), pattern, options);
  AtomicFolder folder(files->folder);
  VolumeWriteReport report;
  forEachSlice(*levels.front(), options, [&](std::int64_t slice, const std::byte* data) {
    const std::string file = folder.temporaryPath() + "/" + files->name.of(slice);
    write(file, data);
    report.bytes += fileBytes(file);
  });
  publish(folder, options);
  return report;
}

}  // namespace isobrick
