#include "isobrick/preprocess/export/volume_writer.h"

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "isobrick/preprocess/export/gzip_file.h"
#include "isobrick/preprocess/export/volume_headers.h"
#include "isobrick/preprocess/export/volume_rows.h"
#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

// Once everything is written.
void publish(AtomicFile& file, const VolumeWriteOptions& options, VolumeWriteReport& report) {
  if (options.before_publishing) options.before_publishing();
  report.bytes += file.position();
  file.commit(options.cancel);
}

void writeText(AtomicFile& file, std::string_view text) { file.write(text.data(), text.size()); }

// A full disk is to show now rather than at the end.
void refuseTooLittleSpace(const VolumeSource& source, const AtomicFile& file) {
  const std::optional<std::uint64_t> have = file.freeBytes();
  const std::uint64_t need = volumeBytes(source.info());
  if (!have || *have >= need) return;
  const auto mebibytes = [](std::uint64_t bytes) { return std::to_string(bytes >> 20) + " MiB"; };
  throw ResumableError("not enough space for '" + file.path() + "': its voxels take " +
                           mebibytes(need) + " and the disk has " + mebibytes(*have) +
                           "; free some space, or choose another folder",
                       {.path = file.path()});
}

// All voxels, as they lie in memory: little-endian (storage/format.h).
void writeVoxels(VolumeSource& source, AtomicFile& file, const VolumeWriteOptions& options) {
  refuseTooLittleSpace(source, file);
  constexpr std::uint64_t kMostPerWrite = std::uint64_t{8} << 20;  // Ctrl-C is checked in between
  forEachRun(source, options, [&](std::int64_t, std::int64_t rows, const std::byte* data) {
    std::uint64_t left = static_cast<std::uint64_t>(rows) * rowBytes(source.info());
    while (left > 0) {
      checkCancel(options);
      const std::uint64_t part = std::min(left, kMostPerWrite);
      file.write(data, part);
      data += part;
      left -= part;
    }
  });
}

// One file: a header, the voxels, and an end.
void writeWhole(VolumeSource& source, const std::string& path, std::string_view header,
                std::string_view end, const VolumeWriteOptions& options,
                VolumeWriteReport& report) {
  AtomicFile file(path);
  writeText(file, header);
  writeVoxels(source, file, options);
  writeText(file, end);
  publish(file, options, report);
}

VolumeWriteReport writeNrrd(VolumeSource& source, const std::string& path,
                            const VolumeWriteOptions& options) {
  VolumeWriteReport report;
  report.space = "LPS";
  writeWhole(source, path, nrrdHeader(source.info()), "", options, report);
  return report;
}

VolumeWriteReport writeMetaImage(VolumeSource& source, const std::string& path,
                                 const VolumeWriteOptions& options) {
  VolumeWriteReport report;
  report.space = "LPS";
  if (path.ends_with(".mha")) {
    writeWhole(source, path, metaImageHeader(source.info(), "LOCAL"), "", options, report);
    return report;
  }
  const std::string data_path = std::filesystem::path(path).replace_extension(".raw").string();
  AtomicFile header_file(path);
  AtomicFile data_file(data_path);
  writeText(header_file,
            metaImageHeader(source.info(), std::filesystem::path(data_path).filename().string()));
  writeVoxels(source, data_file, options);
  // The voxels first: a header without them would be worse than the other way round.
  publish(data_file, options, report);
  report.bytes += header_file.position();
  header_file.commit();
  return report;
}

VolumeWriteReport writeNifti(VolumeSource& source, const std::string& path,
                             const VolumeWriteOptions& options) {
  VolumeWriteReport report;
  report.space = "RAS";
  const auto header = niftiHeader(source.info(), path, report.lost);
  AtomicFile file(path);
  if (path.ends_with(".gz")) {
    GzipFile packed(file);
    packed.write(header, options.cancel);
    forEachRun(source, options, [&](std::int64_t, std::int64_t rows, const std::byte* data) {
      packed.write({data, static_cast<std::size_t>(rows) * rowBytes(source.info())},
                   options.cancel);
    });
    packed.finish();
  } else {
    file.write(header.data(), header.size());
    writeVoxels(source, file, options);
  }
  publish(file, options, report);
  return report;
}

VolumeWriteReport writeVti(VolumeSource& source, const std::string& path,
                           const VolumeWriteOptions& options) {
  VolumeWriteReport report;
  report.space = "LPS";
  if (source.info().geometry.unit != LengthUnit::kUnknown)
    report.lost.push_back("VTK ImageData has no unit of length; its numbers are millimetres");
  writeWhole(source, path, vtiHeader(source.info()), kVtiEnd, options, report);
  return report;
}

VolumeWriteReport writeRaw(VolumeSource& source, const std::string& path,
                           const VolumeWriteOptions& options) {
  VolumeWriteReport report;
  report.space = "none";
  const VolumeInfo& info = source.info();
  report.lost.push_back(
      "dimensions, type, spacing, origin, direction and unit of length are not in the file, which "
      "has voxels " +
      indexText(info.voxels) + " of type " +
      std::string(kVoxelTypes[static_cast<std::size_t>(info.voxel_type)].short_name) +
      " at distances " + pointText(info.geometry.spacing) + " from " +
      pointText(info.geometry.origin));
  writeWhole(source, path, "", "", options, report);
  return report;
}

using Writer = VolumeWriteReport (*)(VolumeSource&, const std::string&, const VolumeWriteOptions&);
struct PlainFormat {
  std::string_view ending;
  Writer write;
};
constexpr PlainFormat kPlainFormats[] = {
    {".nrrd", writeNrrd}, {".mhd", writeMetaImage}, {".mha", writeMetaImage},
    {".nii", writeNifti}, {".nii.gz", writeNifti},  {".vti", writeVti},
    {".raw", writeRaw},
};

const PlainFormat* plainFormatOf(const std::string& path) {
  for (const PlainFormat& format : kPlainFormats)
    if (path.ends_with(format.ending)) return &format;
  return nullptr;
}

}  // namespace

std::vector<std::string> plainVolumeEndings() {
  std::vector<std::string> endings;
  for (const PlainFormat& format : kPlainFormats) endings.emplace_back(format.ending);
  return endings;
}

bool isPlainVolumeName(const std::string& path) { return plainFormatOf(path) != nullptr; }

VolumeWriteReport writeVolume(VolumeSource& source, const std::string& path,
                              const VolumeWriteOptions& options) {
  if (const PlainFormat* const format = plainFormatOf(path))
    return format->write(source, path, options);
  throw unwritable(path,
                   "volumes are written as .nrrd, .mhd, .mha, .nii, .nii.gz, .vti or .raw; choose "
                   "one of these endings");
}

}  // namespace isobrick
