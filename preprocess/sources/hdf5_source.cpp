#include <algorithm>
#include <tuple>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/hdf5_dataset.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/preprocess/sources/stored_voxels.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

// The type of the library's chunks in memory. Halves become floats.
hid_t memoryType(StoredType type) {
  return std::array{
      H5T_NATIVE_UINT8,  H5T_NATIVE_INT8,  H5T_NATIVE_UINT16, H5T_NATIVE_INT16,
      H5T_NATIVE_UINT32, H5T_NATIVE_INT32, H5T_NATIVE_UINT64, H5T_NATIVE_INT64,
      H5T_NATIVE_FLOAT,  H5T_NATIVE_FLOAT, H5T_NATIVE_DOUBLE}[static_cast<std::size_t>(type)];
}

std::optional<StoredType> storedTypeOf(hid_t type) {
  const std::size_t bytes = H5Tget_size(type);
  // A half becomes a float, and h5py's bool is an enum.
  if (H5Tget_class(type) == H5T_FLOAT)
    return isobrick::storedTypeOf('f', std::max(bytes, std::size_t{4}));
  if (H5Tget_class(type) == H5T_ENUM && bytes == 1) return StoredType::kUint8;
  if (H5Tget_class(type) != H5T_INTEGER) return std::nullopt;
  return isobrick::storedTypeOf(H5Tget_sign(type) != H5T_SGN_NONE ? 'i' : 'u', bytes);
}

constexpr int kMostHdf5Axes = 8;

class Hdf5Source final : public VolumeSource {
 public:
  Hdf5Source(const std::string& name, const OpenOptions& options) : options_(options) {
    const Hdf5Call call;
    info_.source = name;
    info_.format = "HDF5";
    std::optional<BdvDataset> xml;
    if (lowerExtension(name) == ".xml") {
      xml = readBdvXml(name);
      path_ = xml->hdf5_path;
      header_files_ = {name};
    } else {
      std::tie(path_, dataset_name_) = splitHdf5Name(name);
    }
    openFile(xml ? name : "");
    openDataset(xml ? &*xml : nullptr);
    takeShape();
    takeType();
    needs_ = checkHdf5Needs(dataset_.id(), file_.id(), path_, info_.source, options_);
    takeChunks();
    countMissingChunks();
    placeHdf5(dataset_.id(), choice_, axes_, scales_, options_.spacing.has_value(), info_);
    reopenWithCache();
    options_.progress = nullptr;
  }

  const VolumeInfo& info() const override { return info_; }
  std::vector<std::string> files() const override {
    std::vector<std::string> files = header_files_;
    files.push_back(path_);
    files.insert(files.end(), needs_.files.begin(), needs_.files.end());
    return files;
  }
  bool readsBoxes() const override { return true; }
  std::uint64_t bufferBytes() const override {
    return cache_bytes_ + chunk_bytes_ + (isInOrder() ? 0 : turnedBytes());
  }

  void readBox(const IndexBox& box, void* out) const override {
    // Layers of chunks, so that a request to stop is checked between them.
    auto* to = static_cast<std::byte*>(out);
    const std::int64_t layer = layerSlices();
    for (std::int64_t z = box.first.z; z < box.end().z;) {
      options_.checkCancel();
      const std::int64_t end = std::min((z / layer + 1) * layer, box.end().z);
      const IndexBox part{Index3(box.first.x, box.first.y, z),
                          Index3(box.count.x, box.count.y, end - z)};
      readPart(part, to);
      to += static_cast<std::size_t>(part.size()) * voxelBytes(info_.voxel_type);
      z = end;
    }
  }

 private:
  void openFile(const std::string& named_by) {
    const InputFile check(path_, named_by);  // gives a better reason why it cannot be opened
    const Hdf5Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
    H5Pset_fclose_degree(access.id(), H5F_CLOSE_STRONG);
    file_ = Hdf5Handle(H5Fopen(path_.c_str(), H5F_ACC_RDONLY, access.id()), H5Fclose);
    if (file_.isValid()) return;
    const std::string reason = hdf5Reason();
    if (H5Fis_hdf5(path_.c_str()) <= 0)
      throw unreadable(path_, "it is no HDF5 file", olderFormat(check),
                       ", or its beginning is missing; convert it, or get it again");
    throw unreadable(path_, "HDF5 cannot open it (", reason,
                     "); check that it is whole, and that no program is writing it");
  }

  // ", but ...", of formats with the same endings.
  static std::string olderFormat(const InputFile& file) {
    std::array<char, 8> first{};
    const std::string_view begin(first.data(), file.readAt(0, first.data(), first.size()));
    if (begin.starts_with("CDF")) return ", but NetCDF 3 (nccopy -k nc4 converts it)";
    if (begin.starts_with("\x0e\x03\x13\x01")) return ", but HDF4 (h4toh5 converts it)";
    if (begin.starts_with("MATLAB 5")) return ", but of a MATLAB before 7.3 (save it with '-v7.3')";
    return "";
  }

  void openDataset(const BdvDataset* xml) {
    choice_ = chooseHdf5Dataset(file_.id(), info_.source, dataset_name_, xml, options_);
    dataset_name_ = choice_.dataset;
    dataset_ = Hdf5Handle(H5Dopen2(file_.id(), dataset_name_.c_str(), H5P_DEFAULT), H5Dclose);
    if (!dataset_.isValid())
      throw unreadable(path_, "its dataset ", quotedText(dataset_name_, 100), " cannot be opened (",
                       hdf5Reason(), "); get the file again");
    creation_ = Hdf5Handle(H5Dget_create_plist(dataset_.id()), H5Pclose);
    type_ = Hdf5Handle(H5Dget_type(dataset_.id()), H5Tclose);
    layout_ = H5Pget_layout(creation_.id());
  }

  void takeShape() {
    const Hdf5Handle space(H5Dget_space(dataset_.id()), H5Sclose);
    const int axes = space.isValid() ? H5Sget_simple_extent_ndims(space.id()) : -1;
    if (axes < 3 || axes > kMostHdf5Axes)
      throw unusableDataset(info_.source, "its dataset has ", axes,
                            " axes, and a volume has three; name another dataset");
    dims_.resize(static_cast<std::size_t>(axes));
    most_dims_.resize(dims_.size());
    H5Sget_simple_extent_dims(space.id(), dims_.data(), most_dims_.data());
    if (!choice_.is_zyx) scales_ = axisScales(dataset_.id(), dims_.size());
    axes_ = findHdf5Axes(dataset_.id(), info_.source, dims_, scales_, choice_, options_);
    for (std::size_t axis = 0; axis < 3; ++axis)
      info_.voxels[static_cast<int>(axis)] =
          static_cast<std::int64_t>(std::min<hsize_t>(dims_[axes_.of_space[axis]], INT64_MAX));
    if (choice_.voxels) takeVoxelsOf(*choice_.voxels);
    checkVoxelCounts(path_, info_.voxels);
    info_.encoding = choice_.encoding + (choice_.encoding.empty() ? "" : ", ") + axes_.encoding;
    if (axes_.encoding.empty()) info_.encoding = choice_.encoding;
    info_.time_step = choice_.took_time ? choice_.time_step : axes_.time_step;
    info_.channel = choice_.took_channel ? choice_.channel : axes_.channel;
    info_.named_channels = choice_.named_channels;
  }

  // The rest of the dataset fills its chunks.
  void takeVoxelsOf(const Index3& voxels) {
    if (glm::any(glm::greaterThan(voxels, info_.voxels)))
      throw unusableDataset(info_.source, "it says that it has ", indexText(voxels, " x "),
                            " voxels, and its dataset has ", indexText(info_.voxels, " x "),
                            "; get the whole file");
    info_.voxels = voxels;
  }

  void takeType() {
    const auto stored = type_.isValid() ? storedTypeOf(type_.id()) : std::nullopt;
    if (!stored)
      throw unusableDataset(
          info_.source,
          "its voxels are no integers or floats of up to 8 bytes; convert them first");
    const auto slope = Hdf5Attribute(dataset_.id(), "scale_factor").numbers(1);
    const auto intercept = Hdf5Attribute(dataset_.id(), "add_offset").numbers(1);
    StoredVoxels voxels;
    voxels.type = *stored;
    if (!slope.empty() || !intercept.empty()) {
      voxels.map =
          StoredVoxels::Map{slope.empty() ? 1 : slope[0], intercept.empty() ? 0 : intercept[0]};
      info_.notes.push_back("scale_factor " + shortText(voxels.map->slope) + " and add_offset " +
                            shortText(voxels.map->intercept) + " were applied");
    }
    map_ = voxels.map;
    info_.voxel_type = voxels.delivered();
    // h5py's bools are named numbers of 8 bits: read in their own type.
    memory_type_ = H5Tget_class(type_.id()) == H5T_ENUM ? type_.id() : memoryType(*stored);
    if (map_)
      memory_type_ = info_.voxel_type == VoxelType::kFloat64 ? H5T_NATIVE_DOUBLE : H5T_NATIVE_FLOAT;
    if (choice_.holds_uint16 && *stored == StoredType::kInt16)
      info_.voxel_type = VoxelType::kUint16;
    const auto missing = Hdf5Attribute(dataset_.id(), "_FillValue").numbers(1);
    if (!missing.empty())
      info_.notes.push_back("voxels of the value " + shortText(missing[0]) +
                            " have no data, and keep it");
  }

  void takeChunks() {
    constexpr std::uint64_t kMostChunkBytes = std::uint64_t{1} << 30;
    if (layout_ != H5D_CHUNKED ||
        H5Pget_chunk(creation_.id(), kMostHdf5Axes, chunk_voxels_.data()) !=
            static_cast<int>(dims_.size()))
      return;
    chunk_bytes_ = std::max<std::uint64_t>(H5Tget_size(type_.id()), 4);
    for (std::size_t i = 0; i < dims_.size(); ++i) {
      if (__builtin_mul_overflow(chunk_bytes_, chunk_voxels_[i], &chunk_bytes_) ||
          chunk_bytes_ > kMostChunkBytes)
        throw unusableDataset(
            info_.source,
            "its chunks have more than 1 GiB; repack it with smaller ones (h5repack -l "
            "CHUNK=64x64x64)");
      // The library makes no chunk that is longer than a dataset of a fixed size, and reads past
      // the end of one whose damaged header states such a chunk.
      if (most_dims_[i] != H5S_UNLIMITED && chunk_voxels_[i] > most_dims_[i])
        throw unreadable(path_,
                         "its chunks are longer than the dataset may become: its header is "
                         "damaged; get the whole file again");
    }
    chunk_slices_ = static_cast<std::int64_t>(chunk_voxels_[axes_.of_space[2]]);
  }

  void countMissingChunks() {
    H5D_space_status_t status = H5D_SPACE_STATUS_ALLOCATED;
    if (H5Dget_space_status(dataset_.id(), &status) < 0 || layout_ == H5D_VIRTUAL) return;
    if (layout_ != H5D_CHUNKED) {
      if (status == H5D_SPACE_STATUS_NOT_ALLOCATED)
        info_.notes.push_back("the dataset was never written: it has its fill value");
      return;
    }
    const Hdf5Handle space(H5Dget_space(dataset_.id()), H5Sclose);
    hsize_t written = 0;
    if (chunk_bytes_ == 0 || H5Dget_num_chunks(dataset_.id(), space.id(), &written) < 0) return;
    hsize_t all = 1;
    for (std::size_t i = 0; i < dims_.size(); ++i)
      if (__builtin_mul_overflow(all, (dims_[i] + chunk_voxels_[i] - 1) / chunk_voxels_[i], &all))
        return;
    if (written < all)
      info_.notes.push_back(
          concat(all - written, " of the ", all,
                 " chunks of the dataset were never written: they have its fill value"));
  }

  // The library's cache holds 1 MiB unless told otherwise: each chunk would be unpacked for every
  // row in it.
  void reopenWithCache() {
    const Hdf5Handle access(H5Pcreate(H5P_DATASET_ACCESS), H5Pclose);
    if (needs_.raw_files_lie_beside) H5Pset_efile_prefix(access.id(), "${ORIGIN}");
    if (chunk_bytes_ > 0) {
      std::uint64_t layer_bytes = chunk_bytes_;
      for (const std::size_t axis : {axes_.of_space[0], axes_.of_space[1]}) {
        layer_bytes *= (dims_[axis] + chunk_voxels_[axis] - 1) / chunk_voxels_[axis];
        if (layer_bytes > options_.memory_bytes) break;
      }
      cache_bytes_ = std::max(chunk_bytes_, std::min(2 * layer_bytes, options_.memory_bytes));
      const std::size_t slots = static_cast<std::size_t>(cache_bytes_ / chunk_bytes_) * 10 + 101;
      H5Pset_chunk_cache(access.id(), slots, cache_bytes_, 1.0);
    }
    dataset_ = {};
    dataset_ = Hdf5Handle(H5Dopen2(file_.id(), dataset_name_.c_str(), access.id()), H5Dclose);
    if (!dataset_.isValid())
      throw unreadable(path_, "its dataset cannot be opened again; get the whole file");
  }

  // ---- reading ---------------------------------------------------------------------------------

  // Whether the dataset has its voxels in the order of a volume.
  bool isInOrder() const {
    return axes_.of_space[0] > axes_.of_space[1] && axes_.of_space[1] > axes_.of_space[2];
  }
  std::uint64_t sliceBytes() const {
    return static_cast<std::uint64_t>(info_.voxels.x * info_.voxels.y) *
           voxelBytes(info_.voxel_type);
  }
  // The most that is held to be turned.
  std::uint64_t turnedBytes() const {
    constexpr std::uint64_t kFewBytes = std::uint64_t{16} << 20;
    return std::max(kFewBytes, sliceBytes());
  }
  std::int64_t layerSlices() const {
    const std::int64_t layer = std::max(std::int64_t{1}, chunk_slices_);
    if (isInOrder()) return layer;
    return std::clamp(static_cast<std::int64_t>(turnedBytes() / sliceBytes()), std::int64_t{1},
                      layer);
  }

  void readPart(const IndexBox& box, std::byte* out) const {
    const auto voxels = static_cast<std::size_t>(box.size());
    if (isInOrder()) {
      readInFileOrder(box, out);
    } else {
      std::vector<std::byte> turned(voxels * voxelBytes(info_.voxel_type));
      readInFileOrder(box, turned.data());
      visitNumberType(info_.voxel_type, [&](auto tag) {
        using T = typename decltype(tag)::Type;
        turn(box.count, reinterpret_cast<const T*>(turned.data()), reinterpret_cast<T*>(out));
      });
    }
    if (!map_) return;
    visitNumberType(info_.voxel_type, [&](auto tag) {
      using T = typename decltype(tag)::Type;
      auto* const values = reinterpret_cast<T*>(out);
      for (std::size_t i = 0; i < voxels; ++i)
        values[i] = static_cast<T>(static_cast<double>(values[i]) * map_->slope + map_->intercept);
    });
  }

  template <typename T>
  void turn(const Index3& count, const T* in, T* out) const {
    Index3 strides(1);
    for (int axis = 0; axis < 3; ++axis)
      for (int other = 0; other < 3; ++other)
        if (axes_.of_space[static_cast<std::size_t>(other)] >
            axes_.of_space[static_cast<std::size_t>(axis)])
          strides[axis] *= count[other];
    for (std::int64_t z = 0; z < count.z; ++z)
      for (std::int64_t y = 0; y < count.y; ++y)
        for (std::int64_t x = 0; x < count.x; ++x)
          *out++ = in[x * strides.x + y * strides.y + z * strides.z];
  }

  void readInFileOrder(const IndexBox& box, void* out) const {
    const Hdf5Call call;
    std::vector<hsize_t> first = axes_.fixed, count(dims_.size(), 1);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      first[axes_.of_space[axis]] = static_cast<hsize_t>(box.first[static_cast<int>(axis)]);
      count[axes_.of_space[axis]] = static_cast<hsize_t>(box.count[static_cast<int>(axis)]);
    }
    const Hdf5Handle file_space(H5Dget_space(dataset_.id()), H5Sclose);
    const Hdf5Handle memory_space(
        H5Screate_simple(static_cast<int>(dims_.size()), count.data(), nullptr), H5Sclose);
    if (H5Sselect_hyperslab(file_space.id(), H5S_SELECT_SET, first.data(), nullptr, count.data(),
                            nullptr) < 0 ||
        H5Dread(dataset_.id(), memory_type_, memory_space.id(), file_space.id(), H5P_DEFAULT, out) <
            0) {
      const std::string reason = hdf5Reason();
      throw fileError(path_, "cannot read slices ", box.first.z, " to ", box.end().z - 1, " of '",
                      info_.source, "': the file is cut short or damaged there (", reason,
                      "); get it again");
    }
  }

  OpenOptions options_;
  std::string path_, dataset_name_;
  std::vector<std::string> header_files_;  // the XML of BigDataViewer
  Hdf5Needs needs_;
  VolumeInfo info_;
  Hdf5Handle file_, dataset_;
  Hdf5Handle creation_, type_;  // of the dataset
  H5D_layout_t layout_ = H5D_CONTIGUOUS;
  Hdf5Choice choice_;
  Hdf5Axes axes_;
  std::vector<Hdf5Scale> scales_;  // empty, or of all axes
  std::vector<hsize_t> dims_, most_dims_;
  std::array<hsize_t, kMostHdf5Axes> chunk_voxels_{};
  std::optional<StoredVoxels::Map> map_;
  hid_t memory_type_ = H5I_INVALID_HID;
  std::uint64_t chunk_bytes_ = 0;  // 0: not in chunks
  std::int64_t chunk_slices_ = 64;
  std::uint64_t cache_bytes_ = 0;
};

}  // namespace

std::unique_ptr<VolumeSource> openHdf5Source(const std::string& name, const OpenOptions& options) {
  return std::make_unique<Hdf5Source>(name, options);
}

}  // namespace isobrick
