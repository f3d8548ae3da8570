#include <algorithm>
#include <array>
#include <filesystem>
#include <vector>

#include "isobrick/preprocess/export/formats/format_writers.h"
#include "isobrick/preprocess/export/volume_rows.h"
#include "isobrick/preprocess/hdf5_handle.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"

namespace isobrick {
namespace {

constexpr std::int64_t kChunkVoxels = 64;

hid_t fileType(VoxelType type) {
  return std::array{H5T_STD_U8LE,  H5T_STD_I8LE,  H5T_STD_U16LE, H5T_STD_I16LE, H5T_IEEE_F32LE,
                    H5T_STD_U64LE, H5T_STD_I64LE, H5T_STD_U32LE, H5T_STD_I32LE, H5T_IEEE_F64LE}
      [static_cast<std::size_t>(type)];
}

std::array<hsize_t, 3> slowestFirst(const Index3& v) {
  return {static_cast<hsize_t>(v.z), static_cast<hsize_t>(v.y), static_cast<hsize_t>(v.x)};
}

class Hdf5Writer {
 public:
  // `file` is its path, `path` the user's text.
  Hdf5Writer(const std::string& file, const std::string& path, const std::string& dataset,
             const VolumeInfo& info)
      : path_(path), info_(info) {
    const Hdf5Call call;
    file_ = Hdf5Handle(createFile(file), H5Fclose);
    dataset_ = Hdf5Handle(createDataset(dataset), H5Dclose);
    if (!dataset_.isValid()) throw failed();
    const GridGeometry& geometry = info.geometry;
    putNumbers("spacing", &geometry.spacing.x, 3);
    putNumbers("origin", &geometry.origin.x, 3);
    putNumbers("direction", &geometry.direction[0].x, 9);
    putText("length_unit", std::string(lengthUnitName(geometry.unit)));
    putText("space", "LPS");
    putText("source", info.source);
  }

  void write(const IndexBox& box, const void* voxels) {
    const Hdf5Call call;
    const auto first = slowestFirst(box.first), count = slowestFirst(box.count);
    const Hdf5Handle file_space(H5Dget_space(dataset_.id()), H5Sclose);
    const Hdf5Handle memory_space(H5Screate_simple(3, count.data(), nullptr), H5Sclose);
    H5Sselect_hyperslab(file_space.id(), H5S_SELECT_SET, first.data(), nullptr, count.data(),
                        nullptr);
    if (H5Dwrite(dataset_.id(), fileType(info_.voxel_type), memory_space.id(), file_space.id(),
                 H5P_DEFAULT, voxels) < 0)
      throw failed();
  }

  void finish() {
    const Hdf5Call call;
    if (!dataset_.close() || !file_.close()) throw failed();
  }

 private:
  ResumableError failed() const {
    return ResumableError("cannot write '" + path_ + "': HDF5 reports a failure; check the name " +
                              "of the dataset, free some space or choose another folder",
                          {.path = path_});
  }

  static hid_t createFile(const std::string& file) {
    // AtomicFile holds the lock of the file already.
    const Hdf5Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
    H5Pset_file_locking(access.id(), false, true);
    return H5Fcreate(file.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, access.id());
  }

  hid_t createDataset(const std::string& name) {
    if (!file_.isValid()) throw failed();
    const auto dims = slowestFirst(info_.voxels);
    const auto chunk = slowestFirst(glm::min(info_.voxels, Index3(kChunkVoxels)));
    const Hdf5Handle space(H5Screate_simple(3, dims.data(), nullptr), H5Sclose);
    const Hdf5Handle creation(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
    H5Pset_chunk(creation.id(), 3, chunk.data());
    H5Pset_obj_track_times(creation.id(), false);  // the same bytes each time
    constexpr unsigned kDeflateLevel = 1;          // scans shrink little more above it
    H5Pset_shuffle(creation.id());
    if (H5Zfilter_avail(H5Z_FILTER_DEFLATE) > 0) H5Pset_deflate(creation.id(), kDeflateLevel);
    const Hdf5Handle links(H5Pcreate(H5P_LINK_CREATE), H5Pclose);
    H5Pset_create_intermediate_group(links.id(), 1);
    return H5Dcreate2(file_.id(), name.c_str(), fileType(info_.voxel_type), space.id(), links.id(),
                      creation.id(), H5P_DEFAULT);
  }

  void putNumbers(const char* name, const double* values, hsize_t count) {
    const Hdf5Handle space(H5Screate_simple(1, &count, nullptr), H5Sclose);
    const Hdf5Handle attribute(
        H5Acreate2(dataset_.id(), name, H5T_IEEE_F64LE, space.id(), H5P_DEFAULT, H5P_DEFAULT),
        H5Aclose);
    if (H5Awrite(attribute.id(), H5T_NATIVE_DOUBLE, values) < 0) throw failed();
  }
  void putText(const char* name, const std::string& text) {
    const Hdf5Handle space(H5Screate(H5S_SCALAR), H5Sclose);
    const Hdf5Handle type(H5Tcopy(H5T_C_S1), H5Tclose);
    H5Tset_size(type.id(), text.size() + 1);
    H5Tset_cset(type.id(), H5T_CSET_UTF8);
    const Hdf5Handle attribute(
        H5Acreate2(dataset_.id(), name, type.id(), space.id(), H5P_DEFAULT, H5P_DEFAULT), H5Aclose);
    if (H5Awrite(attribute.id(), type.id(), text.c_str()) < 0) throw failed();
  }

  std::string path_;
  const VolumeInfo& info_;
  Hdf5Handle file_, dataset_;
};

// Whole chunks: none is packed twice. As many of a layer at a time as memory allows.
void writeChunks(const VolumeSource& source, const ExportOptions& options, Hdf5Writer& writer) {
  const Index3& voxels = source.info().voxels;
  const std::size_t voxel_bytes = voxelBytes(source.info().voxel_type);
  const std::uint64_t column_bytes = kChunkVoxels * kChunkVoxels * kChunkVoxels * voxel_bytes;
  const std::int64_t columns =
      std::max(std::int64_t{1}, static_cast<std::int64_t>(options.memory_bytes / 4 / column_bytes));
  const std::int64_t width = std::min(columns * kChunkVoxels, voxels.x);
  std::vector<std::byte> part;
  for (std::int64_t z = 0; z < voxels.z; z += kChunkVoxels)
    for (std::int64_t y = 0; y < voxels.y; y += kChunkVoxels) {
      for (std::int64_t x = 0; x < voxels.x; x += width) {
        checkCancel(options);
        const Index3 first(x, y, z);
        const IndexBox box{first,
                           glm::min(Index3(width, kChunkVoxels, kChunkVoxels), voxels - first)};
        part.resize(static_cast<std::size_t>(box.size()) * voxel_bytes);
        source.readBox(box, part.data());
        writer.write(box, part.data());
      }
      if (!options.progress) continue;
      const double rows =
          static_cast<double>(std::min(y + kChunkVoxels, voxels.y)) / static_cast<double>(voxels.y);
      const double slices = static_cast<double>(std::min(kChunkVoxels, voxels.z - z));
      options.progress((static_cast<double>(z) + slices * rows) / static_cast<double>(voxels.z));
    }
}

// "/a/b" for "//a/./b/": as the library reads it.
std::string plainName(const std::string& dataset) {
  std::string plain;
  for (const auto& part : std::filesystem::path(dataset).relative_path())
    if (!part.empty() && part != ".") plain.append("/").append(part.string());
  return plain;
}

}  // namespace

VolumeWriteReport writeHdf5(VolumeLevels& levels, const std::string& path,
                            const ExportOptions& options) {
  VolumeWriteReport report;
  report.space = "LPS";
  report.lost.push_back(
      "HDF5 has no rule for spacing, origin and direction; they are attributes of the dataset");
  const std::size_t colon = path.rfind(":/");
  const std::string named = colon == std::string::npos ? path : path.substr(0, colon);
  const std::string dataset =
      colon == std::string::npos ? "/volume" : plainName(path.substr(colon + 1));
  if (dataset.empty()) throw unwritable(path, "it names no dataset; write file.h5:/name");
  AtomicFile file(named);
  makeReadBoxes(levels.front(), folderOf(named), options);
  const VolumeSource& source = *levels.front();
  Hdf5Writer writer(file.temporaryPath(), path, dataset, source.info());
  writeChunks(source, options, writer);
  writer.finish();
  report.bytes = fileBytes(file.temporaryPath());
  publish(file, options);
  return report;
}

}  // namespace isobrick
