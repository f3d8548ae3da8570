#include "isobrick/preprocess/export/volume_writer.h"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <vector>

#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

// A request to cancel is looked at after so many bytes: some milliseconds for any source.
constexpr std::uint64_t kBytesPerLook = std::uint64_t{1} << 20;

// Shortest text that reads back as the same double.
std::string numberText(double value) {
  char text[40];
  for (const int digits : {15, 16, 17}) {
    std::snprintf(text, sizeof text, "%.*g", digits, value);
    if (std::stod(text) == value) break;
  }
  return text;
}

std::string vectorText(const glm::dvec3& v, const char* separator) {
  return numberText(v.x) + separator + numberText(v.y) + separator + numberText(v.z);
}

std::string countsText(const Index3& v) {
  return std::to_string(v.x) + " " + std::to_string(v.y) + " " + std::to_string(v.z);
}

std::string nrrdHeader(const VolumeInfo& info) {
  const char* const type = visitVoxelType(info.voxel_type, [](auto tag) {
    using T = typename decltype(tag)::Type;
    if constexpr (std::is_same_v<T, std::uint8_t>) return "uint8";
    if constexpr (std::is_same_v<T, std::int8_t>) return "int8";
    if constexpr (std::is_same_v<T, std::uint16_t>) return "uint16";
    if constexpr (std::is_same_v<T, std::int16_t>) return "int16";
    if constexpr (std::is_same_v<T, float>) return "float";
  });
  const glm::dmat3 steps = info.geometry.indexToWorldMatrix();
  std::string header = "NRRD0004\n# written by isobrick\ntype: ";
  header += type;
  header += "\ndimension: 3\nspace: left-posterior-superior\nsizes: " + countsText(info.voxels);
  header += "\nspace directions:";
  for (int axis = 0; axis < 3; ++axis) header += " (" + vectorText(steps[axis], ",") + ")";
  header += "\nkinds: domain domain domain\nendian: little\nencoding: raw\nspace origin: (" +
            vectorText(info.geometry.origin, ",") + ")\n\n";
  return header;
}

std::string metaImageHeader(const VolumeInfo& info, const std::string& data_name) {
  static constexpr const char* kTypes[kVoxelTypeCount] = {"MET_UCHAR", "MET_CHAR", "MET_USHORT",
                                                          "MET_SHORT", "MET_FLOAT"};
  const GridGeometry& geometry = info.geometry;
  std::string header =
      "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n"
      "CompressedData = False\n";
  header += "TransformMatrix = " + vectorText(geometry.direction[0], " ") + " " +
            vectorText(geometry.direction[1], " ") + " " + vectorText(geometry.direction[2], " ");
  header += "\nOffset = " + vectorText(geometry.origin, " ");
  header += "\nCenterOfRotation = 0 0 0\nElementSpacing = " + vectorText(geometry.spacing, " ");
  header += "\nDimSize = " + countsText(info.voxels) + "\nElementType = ";
  header += kTypes[static_cast<std::size_t>(info.voxel_type)];
  // The last line of the format.
  return header + "\nElementDataFile = " + data_name + "\n";
}

void writeVoxels(VolumeSource& source, AtomicFile& file, const VolumeWriteOptions& options) {
  const VolumeInfo& info = source.info();
  const std::uint64_t row_bytes =
      static_cast<std::uint64_t>(info.voxels.x) * voxelBytes(info.voxel_type);
  const std::uint64_t slice_bytes = row_bytes * static_cast<std::uint64_t>(info.voxels.y);
  const std::int64_t slices_per_slab = std::clamp(
      static_cast<std::int64_t>(options.slab_bytes / slice_bytes), std::int64_t{1}, info.voxels.z);
  const std::int64_t rows_per_look =
      std::clamp(static_cast<std::int64_t>(kBytesPerLook / row_bytes), std::int64_t{1},
                 slices_per_slab * info.voxels.y);
  std::vector<std::byte> slab(static_cast<std::size_t>(rows_per_look) * row_bytes);
  for (std::int64_t first = 0; first < info.voxels.z; first += slices_per_slab) {
    const std::int64_t count = std::min(slices_per_slab, info.voxels.z - first);
    const std::int64_t end_row = (first + count) * info.voxels.y;
    for (std::int64_t row = first * info.voxels.y; row < end_row; row += rows_per_look) {
      if (options.cancel != nullptr) options.cancel->check();
      const std::int64_t rows = std::min(rows_per_look, end_row - row);
      source.readRows(row, rows, slab.data());
      file.write(slab.data(), static_cast<std::size_t>(rows) * row_bytes);
    }
    if (options.progress)
      options.progress(static_cast<double>(first + count) / static_cast<double>(info.voxels.z));
  }
}

}  // namespace

void writeVolume(VolumeSource& source, const std::string& path, const VolumeWriteOptions& options) {
  const std::filesystem::path name(path);
  const std::string extension = name.extension().string();
  if (extension == ".nrrd") {
    AtomicFile file(path);
    const std::string header = nrrdHeader(source.info());
    file.write(header.data(), header.size());
    writeVoxels(source, file, options);
    file.commit(options.cancel);
  } else if (extension == ".mhd") {
    const std::string data_path = std::filesystem::path(name).replace_extension(".raw").string();
    AtomicFile header_file(path);
    AtomicFile data_file(data_path);
    const std::string header =
        metaImageHeader(source.info(), std::filesystem::path(data_path).filename().string());
    header_file.write(header.data(), header.size());
    writeVoxels(source, data_file, options);
    // The voxels first: a header without them would be worse than the other way round.
    data_file.commit(options.cancel);
    header_file.commit();
  } else if (extension == ".raw") {
    AtomicFile file(path);
    writeVoxels(source, file, options);
    file.commit(options.cancel);
  } else {
    throw Error("cannot write '" + path +
                    "': volumes are written as .nrrd, .mhd or .raw; choose "
                    "one of these endings with -o",
                {.path = path});
  }
}

}  // namespace isobrick
