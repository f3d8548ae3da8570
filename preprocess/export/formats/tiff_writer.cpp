#include <tiffio.h>
#include <unistd.h>

#include <algorithm>
#include <cstdarg>
#include <glm/vec2.hpp>
#include <memory>
#include <new>
#include <optional>

#include "isobrick/preprocess/export/formats/format_writers.h"
#include "isobrick/preprocess/export/volume_rows.h"
#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"

namespace isobrick {
namespace {

struct CloseTiff {
  void operator()(TIFF* file) const { TIFFClose(file); }
};
using TiffFile = std::unique_ptr<TIFF, CloseTiff>;

ResumableError failed(const std::string& path) {
  return ResumableError("cannot write '" + path + "': libtiff reports a failure; free some space " +
                            "or choose another folder",
                        {.path = path});
}

int keepQuiet(TIFF*, void*, const char*, const char*, va_list) { return 1; }

// The library prints on the C stream otherwise. Its handlers for all files are the host's.
TiffFile openToWrite(const std::string& path, const char* mode) {
  struct Free {
    void operator()(TIFFOpenOptions* options) const { TIFFOpenOptionsFree(options); }
  };
  const std::unique_ptr<TIFFOpenOptions, Free> options(TIFFOpenOptionsAlloc());
  if (!options) throw std::bad_alloc();
  TIFFOpenOptionsSetErrorHandlerExtR(options.get(), keepQuiet, nullptr);
  TIFFOpenOptionsSetWarningHandlerExtR(options.get(), keepQuiet, nullptr);
  return TiffFile(TIFFOpenExt(path.c_str(), mode, options.get()));
}

// Pixels along x and y a centimetre, or of an unknown unit a unit. None if the quotients of a TIFF
// do not hold them: the library would cut them off.
std::optional<glm::dvec2> resolutionOf(const GridGeometry& geometry) {
  const double unit = geometry.unit == LengthUnit::kMillimetre ? 10 : 1;
  const glm::dvec2 resolution(unit / geometry.spacing.x, unit / geometry.spacing.y);
  constexpr double kLeast = 1e-4, kMost = 4e9;
  if (std::min(resolution.x, resolution.y) < kLeast || std::max(resolution.x, resolution.y) > kMost)
    return std::nullopt;
  return resolution;
}

// One page. The library has a file's offsets in 32 bits unless it was opened as BigTIFF.
bool writePage(TIFF* file, const VolumeInfo& info, const std::byte* slice) {
  const auto width = static_cast<std::uint32_t>(info.voxels.x);
  const auto height = static_cast<std::uint32_t>(info.voxels.y);
  const VoxelType type = info.voxel_type;
  const int format = visitNumberType(type, [](auto tag) {
    using T = typename decltype(tag)::Type;
    return std::is_floating_point_v<T> ? SAMPLEFORMAT_IEEEFP
           : std::is_signed_v<T>       ? SAMPLEFORMAT_INT
                                       : SAMPLEFORMAT_UINT;
  });
  constexpr std::uint64_t kStripBytes = std::uint64_t{64} << 10;
  const auto rows = static_cast<std::uint32_t>(std::clamp<std::uint64_t>(
      kStripBytes / rowBytes(info), 1, static_cast<std::uint64_t>(height)));
  bool good = TIFFSetField(file, TIFFTAG_IMAGEWIDTH, width) != 0 &&
              TIFFSetField(file, TIFFTAG_IMAGELENGTH, height) != 0 &&
              TIFFSetField(file, TIFFTAG_BITSPERSAMPLE, static_cast<int>(8 * voxelBytes(type))) &&
              TIFFSetField(file, TIFFTAG_SAMPLESPERPIXEL, 1) != 0 &&
              TIFFSetField(file, TIFFTAG_SAMPLEFORMAT, format) != 0 &&
              TIFFSetField(file, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK) != 0 &&
              TIFFSetField(file, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG) != 0 &&
              TIFFSetField(file, TIFFTAG_COMPRESSION, COMPRESSION_NONE) != 0 &&
              TIFFSetField(file, TIFFTAG_ROWSPERSTRIP, rows) != 0;
  if (const auto resolution = resolutionOf(info.geometry))
    good = good &&
           TIFFSetField(file, TIFFTAG_RESOLUTIONUNIT,
                        info.geometry.unit == LengthUnit::kMillimetre ? RESUNIT_CENTIMETER
                                                                      : RESUNIT_NONE) != 0 &&
           TIFFSetField(file, TIFFTAG_XRESOLUTION, resolution->x) != 0 &&
           TIFFSetField(file, TIFFTAG_YRESOLUTION, resolution->y) != 0;
  const std::uint64_t row_bytes = rowBytes(info);
  for (std::uint32_t row = 0, strip = 0; good && row < height; row += rows, ++strip) {
    const std::uint32_t count = std::min(rows, height - row);
    // The library only reads these bytes, but takes a pointer to write.
    auto* const data = const_cast<std::byte*>(slice + row * row_bytes);
    good = TIFFWriteEncodedStrip(file, strip, data, static_cast<tmsize_t>(count * row_bytes)) >= 0;
  }
  return good && TIFFWriteDirectory(file) != 0;
}

VolumeWriteReport writePages(VolumeLevels& levels, const std::string& path,
                             const ExportOptions& options) {
  VolumeSource& source = *levels.front();
  const VolumeInfo& info = source.info();
  refuseLargeSlices(info, path, options);
  VolumeWriteReport report;
  AtomicFile atomic(path);
  const bool is_big = volumeBytes(info) > std::uint64_t{2} << 30;
  const TiffFile file = openToWrite(atomic.temporaryPath(), is_big ? "w8" : "w");
  if (!file) throw failed(path);
  forEachSlice(source, options, [&](std::int64_t, const std::byte* slice) {
    if (!writePage(file.get(), info, slice)) throw failed(path);
  });
  if (TIFFFlush(file.get()) == 0) throw failed(path);
  report.bytes = fileBytes(atomic.temporaryPath());
  publish(atomic, options);
  return report;
}

}  // namespace

VolumeWriteReport writeTiff(VolumeLevels& levels, const std::string& path,
                            const ExportOptions& options) {
  const VolumeInfo& info = levels.front()->info();
  VolumeWriteReport report;
  if (isSlicePattern(path))
    report =
        writeSlices(levels, path, options, [&](const std::string& file, const std::byte* slice) {
          const TiffFile tiff = openToWrite(file, "w");
          if (!tiff || !writePage(tiff.get(), info, slice)) throw failed(path);
        });
  else
    report = writePages(levels, path, options);
  report.space = "none";
  report.lost.push_back(
      resolutionOf(info.geometry)
          ? "origin, direction and the distance of slices are not in a TIFF; of the spacing it has "
            "that of pixels"
          : "origin, direction, spacing and its unit are not in the TIFF: the numbers are beyond "
            "those of the format");
  return report;
}

}  // namespace isobrick
