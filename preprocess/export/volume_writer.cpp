#include "isobrick/preprocess/export/volume_writer.h"

#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <filesystem>
#include <limits>
#include <memory>
#include <new>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

#include "isobrick/preprocess/export/volume_rows.h"
#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

// Packs its input and appends it to `file`, which outlives it. Holds 256 KiB of packed bytes and
// zlib's window. One thread. Throws what AtomicFile::write() throws, and Cancelled.
class GzipFile {
 public:
  explicit GzipFile(AtomicFile& file) : file_(file), packed_(std::size_t{256} << 10) {
    constexpr int kGzip = 15 + 16;  // the largest window, and gzip's header in place of zlib's
    constexpr int kLevel = 3;  // scans shrink little more above it, and take three times as long
    if (deflateInit2(&stream_, kLevel, Z_DEFLATED, kGzip, 8, Z_DEFAULT_STRATEGY) != Z_OK)
      throw std::bad_alloc();
  }
  ~GzipFile() { deflateEnd(&stream_); }
  GzipFile(const GzipFile&) = delete;
  GzipFile& operator=(const GzipFile&) = delete;

  void write(std::span<const std::byte> bytes, const CancelFlag* cancel) {
    constexpr std::size_t kMostPerCall = std::size_t{1} << 20;  // some milliseconds
    while (!bytes.empty()) {
      if (cancel != nullptr) cancel->check();
      const auto part = bytes.first(std::min(bytes.size(), kMostPerCall));
      run(part, Z_NO_FLUSH);
      bytes = bytes.subspan(part.size());
    }
  }
  // The end of the gzip member, with its checksum. Once, and last.
  void finish() { run({}, Z_FINISH); }

 private:
  // With Z_FINISH packs all that zlib still holds, too.
  void run(std::span<const std::byte> bytes, int flush) {
    // zlib does not change its input, but its pointer is not const.
    stream_.next_in =
        const_cast<unsigned char*>(reinterpret_cast<const unsigned char*>(bytes.data()));
    stream_.avail_in = static_cast<uInt>(bytes.size());
    int result;
    do {
      stream_.next_out = packed_.data();
      stream_.avail_out = static_cast<uInt>(packed_.size());
      result = deflate(&stream_, flush);
      if (result == Z_STREAM_ERROR) throw std::logic_error("zlib was used wrongly");
      file_.write(packed_.data(), packed_.size() - stream_.avail_out);
    } while (flush == Z_FINISH ? result != Z_STREAM_END : stream_.avail_out == 0);
  }

  AtomicFile& file_;
  std::vector<unsigned char> packed_;
  z_stream stream_ = {};
};

constexpr char kVtiEnd[] = "\n  </AppendedData>\n</VTKFile>\n";

// The header of a NIfTI-1 file (.nii) with the four bytes that say that no extension follows; the
// voxels come next. Adds a line to `lost` if single precision changes the geometry. Throws Error
// for more than 32767 voxels along an axis.
constexpr std::size_t kNiftiBytes = 352;

// The name of the voxel type in a format: in the order of VoxelType.
using TypeNames = const char * [std::size(kVoxelTypes)];
const char* typeName(const TypeNames& names, const VolumeInfo& info) {
  return names[static_cast<std::size_t>(info.voxel_type)];
}

template <typename T>
void put(std::array<std::byte, kNiftiBytes>& header, std::size_t at, T value) {
  std::memcpy(header.data() + at, &value, sizeof value);
}

// The unit quaternion (b, c, d; a is not negative) of a rotation.
glm::dvec3 quaternionOf(const glm::dmat3& r) {
  // r[column][row]
  const double trace = r[0][0] + r[1][1] + r[2][2];
  double a, b, c, d;
  if (trace > 0) {
    a = std::sqrt(1 + trace) / 2;
    b = (r[1][2] - r[2][1]) / (4 * a);
    c = (r[2][0] - r[0][2]) / (4 * a);
    d = (r[0][1] - r[1][0]) / (4 * a);
  } else if (r[0][0] >= r[1][1] && r[0][0] >= r[2][2]) {
    b = std::sqrt(1 + r[0][0] - r[1][1] - r[2][2]) / 2;
    a = (r[1][2] - r[2][1]) / (4 * b);
    c = (r[1][0] + r[0][1]) / (4 * b);
    d = (r[2][0] + r[0][2]) / (4 * b);
  } else if (r[1][1] >= r[2][2]) {
    c = std::sqrt(1 + r[1][1] - r[0][0] - r[2][2]) / 2;
    a = (r[2][0] - r[0][2]) / (4 * c);
    b = (r[1][0] + r[0][1]) / (4 * c);
    d = (r[2][1] + r[1][2]) / (4 * c);
  } else {
    d = std::sqrt(1 + r[2][2] - r[0][0] - r[1][1]) / 2;
    a = (r[0][1] - r[1][0]) / (4 * d);
    b = (r[2][0] + r[0][2]) / (4 * d);
    c = (r[2][1] + r[1][2]) / (4 * d);
  }
  return a < 0 ? glm::dvec3(-b, -c, -d) : glm::dvec3(b, c, d);
}

// The place in the world, as a matrix and as a rotation. False if single precision changes it.
bool putNiftiGeometry(const GridGeometry& geometry, std::array<std::byte, kNiftiBytes>& header) {
  bool is_exact = true;
  const auto putSingle = [&](std::size_t at, double value) {
    const auto single = static_cast<float>(value);
    is_exact = is_exact && static_cast<double>(single) == value;
    put(header, at, single);
  };
  // From LPS, in which the source counts, to the format's RAS.
  glm::dmat3 direction = geometry.direction;
  glm::dvec3 origin = geometry.origin;
  for (int row = 0; row < 2; ++row) {
    origin[row] = 0.0 - origin[row];
    for (int axis = 0; axis < 3; ++axis) direction[axis][row] = 0.0 - direction[axis][row];
  }
  for (std::size_t row = 0; row < 3; ++row) {
    const int r = static_cast<int>(row);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const int a = static_cast<int>(axis);
      putSingle(280 + 16 * row + 4 * axis, direction[a][r] * geometry.spacing[a]);
    }
    putSingle(280 + 16 * row + 12, origin[r]);
    putSingle(80 + 4 * row, geometry.spacing[r]);
    putSingle(268 + 4 * row, origin[r]);
  }
  const double handedness = glm::determinant(direction) < 0 ? -1 : 1;
  put(header, 76, static_cast<float>(handedness));
  direction[2] *= handedness;
  const glm::dvec3 quaternion = quaternionOf(direction);
  for (std::size_t i = 0; i < 3; ++i)
    put(header, 256 + 4 * i, static_cast<float>(quaternion[static_cast<int>(i)]));
  return is_exact;
}

std::string nrrdHeader(const VolumeInfo& info) {
  static constexpr TypeNames kTypes = {"uint8",  "int8",  "uint16", "int16", "float",
                                       "uint64", "int64", "uint32", "int32", "double"};
  const glm::dmat3 steps = info.geometry.indexToWorldMatrix();
  std::string header = "NRRD0004\n# written by isobrick\ntype: ";
  header += typeName(kTypes, info);
  header += "\ndimension: 3\nspace: left-posterior-superior\nsizes: " + indexText(info.voxels, " ");
  header += "\nspace directions:";
  for (int axis = 0; axis < 3; ++axis) header += " (" + pointText(steps[axis], ",") + ")";
  // No text is no unit: without the field patients' spaces count as millimetres.
  const std::string unit = info.geometry.unit == LengthUnit::kMillimetre ? "\"mm\"" : "\"\"";
  header += "\nspace units: " + unit + " " + unit + " " + unit;
  header += "\nkinds: domain domain domain\nendian: little\nencoding: raw\nspace origin: (" +
            pointText(info.geometry.origin, ",") + ")\n\n";
  return header;
}

// `data_name`: the file with the voxels, or "LOCAL" if they follow.
std::string metaImageHeader(const VolumeInfo& info, const std::string& data_name) {
  static constexpr TypeNames kTypes = {"MET_UCHAR", "MET_CHAR",       "MET_USHORT",    "MET_SHORT",
                                       "MET_FLOAT", "MET_ULONG_LONG", "MET_LONG_LONG", "MET_UINT",
                                       "MET_INT",   "MET_DOUBLE"};
  const GridGeometry& geometry = info.geometry;
  std::string header =
      "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n"
      "CompressedData = False\n";
  header += "TransformMatrix = " + pointText(geometry.direction[0], " ") + " " +
            pointText(geometry.direction[1], " ") + " " + pointText(geometry.direction[2], " ");
  header += "\nOffset = " + pointText(geometry.origin, " ");
  header +=
      std::string("\nDistanceUnits = ") + (geometry.unit == LengthUnit::kMillimetre ? "mm" : "?");
  header += "\nCenterOfRotation = 0 0 0\nElementSpacing = " + pointText(geometry.spacing, " ");
  header += "\nDimSize = " + indexText(info.voxels, " ") + "\nElementType = ";
  header += typeName(kTypes, info);
  // The last line of the format.
  return header + "\nElementDataFile = " + data_name + "\n";
}

// All of a .vti up to the first voxel; kVtiEnd follows the last.
std::string vtiHeader(const VolumeInfo& info) {
  static constexpr TypeNames kTypes = {"UInt8",  "Int8",  "UInt16", "Int16", "Float32",
                                       "UInt64", "Int64", "UInt32", "Int32", "Float64"};
  const Index3 last = info.voxels - Index3(1);
  const std::string extent = "0 " + indexText(last, " 0 ");
  const glm::dmat3 rows = glm::transpose(info.geometry.direction);
  std::string header =
      "<?xml version=\"1.0\"?>\n<!-- written by isobrick; world coordinates are LPS, their unit "
      "is " +
      std::string(lengthUnitName(info.geometry.unit)) +
      " -->\n<VTKFile type=\"ImageData\" version=\"1.0\" byte_order=\"LittleEndian\" "
      "header_type=\"UInt64\">\n  <ImageData WholeExtent=\"";
  header += extent + "\" Origin=\"" + pointText(info.geometry.origin, " ") + "\" Spacing=\"" +
            pointText(info.geometry.spacing, " ") + "\" Direction=\"" + pointText(rows[0], " ") +
            " " + pointText(rows[1], " ") + " " + pointText(rows[2], " ") + "\">\n";
  header += "    <Piece Extent=\"" + extent +
            "\">\n      <PointData Scalars=\"values\">\n        <DataArray type=\"" +
            typeName(kTypes, info) +
            "\" Name=\"values\" format=\"appended\" offset=\"0\"/>\n      </PointData>\n"
            "      <CellData/>\n    </Piece>\n  </ImageData>\n"
            "  <AppendedData encoding=\"raw\">\n   _";
  const std::uint64_t bytes = volumeBytes(info);
  header.append(reinterpret_cast<const char*>(&bytes), sizeof bytes);
  return header;
}

std::array<std::byte, kNiftiBytes> niftiHeader(const VolumeInfo& info, const std::string& path,
                                               std::vector<std::string>& lost) {
  struct Type {
    std::int16_t code, bits;
  };
  static constexpr Type kTypes[std::size(kVoxelTypes)] = {
      {2, 8},     {256, 8},   {512, 16}, {4, 16}, {16, 32},
      {1280, 64}, {1024, 64}, {768, 32}, {8, 32}, {64, 64}};
  for (int axis = 0; axis < 3; ++axis)
    if (info.voxels[axis] > std::numeric_limits<std::int16_t>::max())
      throw unwritable(path, "NIfTI-1 has at most 32767 voxels along an axis, and this volume ",
                       info.voxels[axis], "; write .nrrd, or a coarser level");
  std::array<std::byte, kNiftiBytes> header{};
  put(header, 0, std::int32_t{348});
  put(header, 38, 'r');
  put(header, 40, std::int16_t{3});
  for (std::size_t axis = 0; axis < 7; ++axis)
    put(header, 42 + 2 * axis,
        static_cast<std::int16_t>(axis < 3 ? info.voxels[static_cast<int>(axis)] : 1));
  const Type type = kTypes[static_cast<std::size_t>(info.voxel_type)];
  put(header, 70, type.code);
  put(header, 72, type.bits);
  if (!putNiftiGeometry(info.geometry, header))
    lost.push_back("spacing, origin and direction were rounded to single precision");
  for (std::size_t axis = 3; axis < 7; ++axis) put(header, 80 + 4 * axis, 1.0f);
  put(header, 108, static_cast<float>(kNiftiBytes));
  put(header, 112, 1.0f);  // slope
  if (info.geometry.unit == LengthUnit::kMillimetre) put(header, 123, char{2});
  put(header, 252, std::int16_t{1});  // qform and sform: the scanner's space
  put(header, 254, std::int16_t{1});
  std::memcpy(header.data() + 148, "written by isobrick", 19);
  std::memcpy(header.data() + 344, "n+1", 4);
  return header;
}

// Once everything is written.
void publish(AtomicFile& file, const VolumeWriteOptions& options, VolumeWriteReport& report) {
  report.bytes += file.position();
  publish(file, options);
}

void writeText(AtomicFile& file, std::string_view text) { file.write(text.data(), text.size()); }

// A full disk is to show now rather than at the end.
void refuseTooLittleSpace(const VolumeSource& source, const AtomicFile& file) {
  const std::optional<std::uint64_t> have = file.freeBytes();
  const std::uint64_t need = volumeBytes(source.info());
  if (!have || *have >= need) return;
  const auto mebibytes = [](std::uint64_t bytes) { return concat(bytes >> 20, " MiB"); };
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

// A header would be believed of other voxels, so none is there while they change, and no voxels
// stay without one.
void publishPair(AtomicFile& header, const fs::path& header_path, AtomicFile& data,
                 const fs::path& data_path, const VolumeWriteOptions& options) {
  if (options.before_publishing) options.before_publishing();
  // First all that is likely to fail: so long the older pair is there.
  for (const AtomicFile* const file : {&data, &header})
    if (fsync(file->fd()) != 0) failWriting(file->path(), errno);
  checkCancel(options);
  try {
    if (const std::error_code error = removeName(header_path))
      failWriting(header.path(), error.value());
    if (const int error = syncFolderOf(header.path())) failWriting(header.path(), error);
    data.commit();
    header.commit();
  } catch (...) {
    if (!isNameTaken(header_path)) removeName(data_path);
    throw;
  }
}

VolumeWriteReport writeMetaImage(VolumeSource& source, const std::string& path,
                                 const VolumeWriteOptions& options) {
  VolumeWriteReport report;
  report.space = "LPS";
  if (path.ends_with(".mha")) {
    writeWhole(source, path, metaImageHeader(source.info(), "LOCAL"), "", options, report);
    return report;
  }
  // Paths, so that to remove them takes no memory.
  const fs::path header_path = path, data_path = fs::path(path).replace_extension(".raw");
  AtomicFile header_file(path);
  AtomicFile data_file(data_path.string());
  writeVoxels(source, data_file, options);
  // Only now: of a killed run it says that the voxels of that name are its own (tools/outputs.cpp).
  writeText(header_file, metaImageHeader(source.info(), data_path.filename().string()));
  report.bytes = header_file.position() + data_file.position();
  publishPair(header_file, header_path, data_file, data_path, options);
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
