#include <algorithm>
#include <array>
#include <filesystem>
#include <mutex>
#include <optional>
#include <tuple>
#include <vector>

#include "isobrick/preprocess/hdf5_handle.h"
#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/rows_as_boxes.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/preprocess/sources/stored_voxels.h"
#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

Error cannotRead(const std::string& path, const std::string& reason) {
  return unreadable(path, reason + "; check that the file is whole and not damaged");
}

// It prints a stack of calls for everything that fails.
void silenceHdf5() { H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr); }

// The type of the library's chunks in memory.
hid_t memoryType(StoredType type) {
  switch (type) {
    case StoredType::kUint8:
      return H5T_NATIVE_UINT8;
    case StoredType::kInt8:
      return H5T_NATIVE_INT8;
    case StoredType::kUint16:
      return H5T_NATIVE_UINT16;
    case StoredType::kInt16:
      return H5T_NATIVE_INT16;
    // All others become float32: by the library, as it reads.
    default:
      return H5T_NATIVE_FLOAT;
  }
}

std::optional<StoredType> storedTypeOf(hid_t type) {
  const std::size_t bytes = H5Tget_size(type);
  // A half is converted like a double, and h5py's bool is an enum.
  if (H5Tget_class(type) == H5T_FLOAT) return isobrick::storedTypeOf('f', bytes == 2 ? 8 : bytes);
  if (H5Tget_class(type) == H5T_ENUM && bytes == 1) return StoredType::kUint8;
  if (H5Tget_class(type) != H5T_INTEGER) return std::nullopt;
  return isobrick::storedTypeOf(H5Tget_sign(type) != H5T_SGN_NONE ? 'i' : 'u', bytes);
}

constexpr int kMostAxes = 8;
constexpr std::size_t kMostDatasets = 12;  // that are listed

// Datasets of three axes or more below a group, by name.
struct DatasetSearch {
  std::vector<std::string> names;
};
herr_t noteDataset(hid_t group, const char* name, const H5O_info_t* info, void* search) {
  if (info->type != H5O_TYPE_DATASET) return 0;
  const Hdf5Handle dataset(H5Dopen2(group, name, H5P_DEFAULT), H5Dclose);
  if (!dataset.isValid()) return 0;
  const Hdf5Handle space(H5Dget_space(dataset.id()), H5Sclose);
  auto& names = static_cast<DatasetSearch*>(search)->names;
  if (space.isValid() && H5Sget_simple_extent_ndims(space.id()) >= 3)
    names.push_back(std::string("/") + name);
  return names.size() > kMostDatasets ? 1 : 0;
}

// The numbers of an attribute, or none if it is missing or of another length.
std::vector<double> attribute(hid_t object, const char* name, std::size_t count) {
  if (H5Aexists(object, name) <= 0) return {};
  const Hdf5Handle found(H5Aopen(object, name, H5P_DEFAULT), H5Aclose);
  if (!found.isValid()) return {};
  const Hdf5Handle space(H5Aget_space(found.id()), H5Sclose);
  const Hdf5Handle type(H5Aget_type(found.id()), H5Tclose);
  if (H5Sget_simple_extent_npoints(space.id()) != static_cast<hssize_t>(count)) return {};
  const H5T_class_t kind = H5Tget_class(type.id());
  if (kind != H5T_FLOAT && kind != H5T_INTEGER) return {};
  std::vector<double> values(count);
  if (H5Aread(found.id(), H5T_NATIVE_DOUBLE, values.data()) < 0) return {};
  return values;
}

// The text of an attribute, or "".
std::string textAttribute(hid_t object, const char* name) {
  if (H5Aexists(object, name) <= 0) return {};
  const Hdf5Handle found(H5Aopen(object, name, H5P_DEFAULT), H5Aclose);
  if (!found.isValid()) return {};
  const Hdf5Handle type(H5Aget_type(found.id()), H5Tclose);
  const Hdf5Handle space(H5Aget_space(found.id()), H5Sclose);
  if (H5Tget_class(type.id()) != H5T_STRING || H5Sget_simple_extent_npoints(space.id()) != 1)
    return {};
  if (H5Tis_variable_str(type.id()) > 0) {
    char* text = nullptr;
    if (H5Aread(found.id(), type.id(), &text) < 0 || text == nullptr) return {};
    std::string result(text);
    H5free_memory(text);
    return result;
  }
  constexpr std::size_t kMost = 1000;
  const std::size_t bytes = H5Tget_size(type.id());
  std::string text(bytes, '\0');
  if (bytes > kMost || H5Aread(found.id(), type.id(), text.data()) < 0) return {};
  return text.c_str();  // up to the characters that fill it up
}

class Hdf5Source final : public VolumeSource {
 public:
  Hdf5Source(const std::string& name, const OpenOptions& options) : options_(options) {
    const std::lock_guard lock(hdf5Mutex());
    std::tie(path_, dataset_name_) = splitHdf5Name(name);
    info_.source = name;
    info_.format = "HDF5";
    openFile();
    openDataset();
    takeShape();
    takeType();
    checkFilters();
    findSourceFiles();
    countMissingChunks();
    takeGeometry();
    reopenWithCache();
    options_.progress = nullptr;
  }
  ~Hdf5Source() override {
    const std::lock_guard lock(hdf5Mutex());
    dataset_ = {};
    file_ = {};
  }

  const VolumeInfo& info() const override { return info_; }
  std::vector<std::string> files() const override {
    std::vector<std::string> files = {path_};
    files.insert(files.end(), source_files_.begin(), source_files_.end());
    return files;
  }
  std::string identity() const override { return {}; }
  bool readsBoxes() const override { return true; }
  std::uint64_t bufferBytes() const override { return cache_bytes_ + chunk_bytes_; }

  void readRows(std::int64_t first, std::int64_t count, void* out) override {
    readRowsAsBoxes(*this, first, count, out);
  }

  void readBox(const IndexBox& box, void* out) const override {
    // Layers of chunks, so that a request to stop is checked between them.
    auto* to = static_cast<std::byte*>(out);
    const std::int64_t layer = std::max(std::int64_t{1}, chunk_slices_);
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
  void openFile() {
    silenceHdf5();
    const InputFile check(path_);  // gives a better reason why it cannot be opened
    const Hdf5Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
    H5Pset_fclose_degree(access.id(), H5F_CLOSE_STRONG);
    file_ = Hdf5Handle(H5Fopen(path_.c_str(), H5F_ACC_RDONLY, access.id()), H5Fclose);
    if (!file_.isValid()) throw cannotRead(path_, "it is no HDF5 file, or cut short or damaged");
  }

  void openDataset() {
    DatasetSearch search;
    if (dataset_name_.empty()) {
      if (H5Ovisit2(file_.id(), H5_INDEX_NAME, H5_ITER_INC, noteDataset, &search, H5O_INFO_BASIC) <
          0)
        throw cannotRead(path_, "its list of datasets is damaged");
      if (search.names.size() != 1) throw unclear(search);
      dataset_name_ = search.names.front();
    }
    dataset_ = Hdf5Handle(H5Dopen2(file_.id(), dataset_name_.c_str(), H5P_DEFAULT), H5Dclose);
    if (dataset_.isValid()) return;
    H5Ovisit2(file_.id(), H5_INDEX_NAME, H5_ITER_INC, noteDataset, &search, H5O_INFO_BASIC);
    throw Error("'" + path_ + "' has no dataset " + quotedText(dataset_name_, 100) +
                    " that can be opened; it has " + listOf(search),
                {.path = path_});
  }

  static std::string listOf(const DatasetSearch& search) {
    if (search.names.empty()) return "none of three axes";
    std::string text;
    for (std::size_t i = 0; i < std::min(search.names.size(), kMostDatasets); ++i)
      text += (i > 0 ? ", " : "") + quotedText(search.names[i], 100);
    return text + (search.names.size() > kMostDatasets ? ", ..." : "");
  }

  Error unclear(const DatasetSearch& search) const {
    return Error("which dataset of '" + path_ + "' is unclear: it has " + listOf(search) +
                     "; name one, as in " + path_ + ":/path",
                 {.path = path_});
  }

  void takeShape() {
    const Hdf5Handle space(H5Dget_space(dataset_.id()), H5Sclose);
    axes_ = space.isValid() ? H5Sget_simple_extent_ndims(space.id()) : -1;
    std::array<hsize_t, kMostAxes> dims{};
    if (axes_ < 3 || axes_ > kMostAxes ||
        H5Sget_simple_extent_dims(space.id(), dims.data(), nullptr) != axes_)
      throw Error("cannot use '" + info_.source + "': its dataset has " + std::to_string(axes_) +
                      " axes, and a volume has three; name another dataset",
                  {.path = path_});
    // The axes of space are the last three of more than one element, or the last three.
    std::vector<int> wide;
    for (int i = 0; i < axes_; ++i)
      if (dims[static_cast<std::size_t>(i)] != 1) wide.push_back(i);
    int further = -1;
    if (wide.size() == 4 && options_.channel) {
      further = wide.front();
      wide.erase(wide.begin());
    }
    if (wide.size() > 3)
      throw Error("cannot use '" + info_.source + "': its dataset has " +
                      std::to_string(wide.size()) + " axes of more than one element, and three " +
                      "are read, or of four those behind an index of the first",
                  {.path = path_}, {Remedy::kChooseChannel});
    for (int i = axes_ - 1; wide.size() < 3; --i)
      if (std::find(wide.begin(), wide.end(), i) == wide.end()) {
        wide.push_back(i);
        std::sort(wide.begin(), wide.end());
      }
    for (int axis = 0; axis < 3; ++axis) {
      axis_[static_cast<std::size_t>(axis)] = wide[static_cast<std::size_t>(2 - axis)];
      const hsize_t n = dims[static_cast<std::size_t>(wide[static_cast<std::size_t>(2 - axis)])];
      info_.voxels[axis] = static_cast<std::int64_t>(std::min<hsize_t>(n, INT64_MAX));
    }
    checkVoxelCounts(path_, info_.voxels);
    if (further >= 0) {
      const auto count = dims[static_cast<std::size_t>(further)];
      if (static_cast<hsize_t>(*options_.channel) >= count)
        throw Error("'" + info_.source + "' has the channels 0 to " + std::to_string(count - 1) +
                        ", and not " + std::to_string(*options_.channel) + "; choose one of these",
                    {.path = path_});
      fixed_[static_cast<std::size_t>(further)] = static_cast<hsize_t>(*options_.channel);
      info_.encoding = "channel " + std::to_string(*options_.channel);
    }
  }

  void takeType() {
    const Hdf5Handle type(H5Dget_type(dataset_.id()), H5Tclose);
    const auto stored = type.isValid() ? storedTypeOf(type.id()) : std::nullopt;
    if (!stored)
      throw Error("cannot use '" + info_.source + "': its voxels are no integers or floats of up " +
                      "to 8 bytes; convert them first",
                  {.path = path_});
    const StoredVoxels voxels{*stored, false, {}, false};
    info_.voxel_type = voxels.delivered();
    is_enum_ = H5Tget_class(type.id()) == H5T_ENUM;
    memory_type_ = memoryType(*stored);
    if (!voxels.keepsType()) info_.notes.push_back("voxels were converted to float32");
  }

  void checkFilters() {
    const Hdf5Handle creation(H5Dget_create_plist(dataset_.id()), H5Pclose);
    const int filters = H5Pget_nfilters(creation.id());
    for (int i = 0; i < filters; ++i) {
      unsigned flags = 0;
      std::size_t values = 0;
      std::array<char, 80> name{};
      unsigned config = 0;
      const H5Z_filter_t filter =
          H5Pget_filter2(creation.id(), static_cast<unsigned>(i), &flags, &values, nullptr,
                         name.size() - 1, name.data(), &config);
      if (H5Zfilter_avail(filter) > 0) continue;
      throw Error("cannot read '" + info_.source + "': its chunks are packed with the filter " +
                      std::to_string(filter) + " " + quotedText(name.data(), 60) +
                      ", which this machine's HDF5 lacks; install its plugin (hdf5-plugin or " +
                      "hdf5-filter-plugin packages, HDF5_PLUGIN_PATH), or repack with h5repack -f "
                      "GZIP=1",
                  {.path = path_});
    }
    std::array<hsize_t, kMostAxes> chunk{};
    constexpr std::uint64_t kMostChunkBytes = std::uint64_t{1} << 30;
    if (H5Pget_layout(creation.id()) == H5D_CHUNKED &&
        H5Pget_chunk(creation.id(), kMostAxes, chunk.data()) == axes_) {
      const Hdf5Handle type(H5Dget_type(dataset_.id()), H5Tclose);
      chunk_bytes_ = std::max<std::uint64_t>(H5Tget_size(type.id()), 4);
      for (int i = 0; i < axes_; ++i)
        if (__builtin_mul_overflow(chunk_bytes_, chunk[static_cast<std::size_t>(i)],
                                   &chunk_bytes_) ||
            chunk_bytes_ > kMostChunkBytes)
          throw Error("cannot use '" + info_.source +
                          "': its chunks have more than 1 GiB; repack " +
                          "it with smaller ones (h5repack -l CHUNK=64x64x64)",
                      {.path = path_});
      refuseImpossibleChunks(chunk);
      chunk_slices_ = static_cast<std::int64_t>(chunk[static_cast<std::size_t>(axis_[2])]);
      chunk_voxels_ = chunk;
    }
  }

  // The library makes no chunk that is longer than a dataset of a fixed size, and reads past the
  // end of one whose damaged header states such a chunk.
  void refuseImpossibleChunks(const std::array<hsize_t, kMostAxes>& chunk) const {
    const Hdf5Handle space(H5Dget_space(dataset_.id()), H5Sclose);
    std::array<hsize_t, kMostAxes> dims{}, most{};
    if (H5Sget_simple_extent_dims(space.id(), dims.data(), most.data()) != axes_) return;
    for (std::size_t i = 0; i < static_cast<std::size_t>(axes_); ++i)
      if (most[i] != H5S_UNLIMITED && chunk[i] > most[i])
        throw cannotRead(path_, "its chunks are longer than the dataset may become");
  }

  // A virtual dataset takes its voxels from others. The library gives fill values for those that it
  // does not find.
  void findSourceFiles() {
    const Hdf5Handle creation(H5Dget_create_plist(dataset_.id()), H5Pclose);
    std::size_t count = 0;
    if (H5Pget_layout(creation.id()) != H5D_VIRTUAL ||
        H5Pget_virtual_count(creation.id(), &count) < 0)
      return;
    const auto textOf = [&](auto&& get, std::size_t i) {
      const ssize_t length = get(creation.id(), i, nullptr, 0);
      std::string text(length > 0 ? static_cast<std::size_t>(length) + 1 : 0, '\0');
      if (length > 0) get(creation.id(), i, text.data(), text.size());
      text.resize(length > 0 ? static_cast<std::size_t>(length) : 0);
      return text;
    };
    for (std::size_t i = 0; i < count; ++i) {
      options_.checkCancel();
      const std::string name = textOf(H5Pget_virtual_filename, i);
      const std::string dataset = textOf(H5Pget_virtual_dsetname, i);
      if (name.find('%') != std::string::npos || dataset.find('%') != std::string::npos)
        throw Error("cannot use '" + info_.source +
                        "': it takes its voxels from as many files as " + "match " +
                        quotedText(name, 100) +
                        ", of which nobody knows whether all are there; copy it into one dataset",
                    {.path = path_});
      checkSource(name, dataset);
    }
  }

  // Searches as the library does: beside the file, then in the working directory.
  void checkSource(const std::string& name, const std::string& dataset) {
    const std::string beside =
        (std::filesystem::path(path_).parent_path() / std::filesystem::path(name)).string();
    const std::string source = name == "." ? path_ : inputIsThere(beside) ? beside : name;
    const bool is_new = name != "." && std::find(source_files_.begin(), source_files_.end(),
                                                 source) == source_files_.end();
    if (is_new) {
      const InputFile check(source, path_);  // throws the reason why it cannot be opened
      source_files_.push_back(source);
    }
    const Hdf5Handle opened(
        name == "." ? H5I_INVALID_HID : H5Fopen(source.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT),
        H5Fclose);
    const Hdf5Handle found(
        H5Dopen2(name == "." ? file_.id() : opened.id(), dataset.c_str(), H5P_DEFAULT), H5Dclose);
    if (!found.isValid())
      throw unreadable(source, "it has no dataset " + quotedText(dataset, 100) + ", from which '" +
                                   info_.source + "' takes its voxels; get the whole file");
  }

  void countMissingChunks() {
    const Hdf5Handle creation(H5Dget_create_plist(dataset_.id()), H5Pclose);
    const H5D_layout_t layout = H5Pget_layout(creation.id());
    H5D_space_status_t status = H5D_SPACE_STATUS_ALLOCATED;
    if (H5Dget_space_status(dataset_.id(), &status) < 0 || layout == H5D_VIRTUAL) return;
    if (layout != H5D_CHUNKED) {
      if (status == H5D_SPACE_STATUS_NOT_ALLOCATED)
        info_.notes.push_back("the dataset was never written: it has its fill value");
      return;
    }
    const Hdf5Handle space(H5Dget_space(dataset_.id()), H5Sclose);
    std::array<hsize_t, kMostAxes> dims{};
    hsize_t written = 0;
    if (H5Sget_simple_extent_dims(space.id(), dims.data(), nullptr) != axes_ ||
        H5Dget_num_chunks(dataset_.id(), space.id(), &written) < 0)
      return;
    hsize_t all = 1;
    for (std::size_t i = 0; i < static_cast<std::size_t>(axes_); ++i)
      if (__builtin_mul_overflow(all, (dims[i] + chunk_voxels_[i] - 1) / chunk_voxels_[i], &all))
        return;
    if (written < all)
      info_.notes.push_back(std::to_string(all - written) + " of the " + std::to_string(all) +
                            " chunks of the dataset were never written: they have its fill value");
  }

  void takeGeometry() {
    GridGeometry& geometry = info_.geometry;
    const auto spacing = attribute(dataset_.id(), "spacing", 3);
    const auto origin = attribute(dataset_.id(), "origin", 3);
    const auto direction = attribute(dataset_.id(), "direction", 9);
    const auto element_size = attribute(dataset_.id(), "element_size_um", 3);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const int a = static_cast<int>(axis);
      if (!spacing.empty())
        geometry.spacing[a] = spacing[axis];
      else if (!element_size.empty())
        geometry.spacing[a] = element_size[2 - axis] / 1000;
      if (!origin.empty()) geometry.origin[a] = origin[axis];
      for (std::size_t row = 0; row < 3 && !direction.empty(); ++row)
        geometry.direction[a][static_cast<int>(row)] = direction[3 * axis + row];
    }
    if (spacing.empty() && element_size.empty())
      info_.notes.push_back("the dataset says no spacing; 1 was used");
    const bool is_in_micrometres = spacing.empty() && !element_size.empty();
    if (is_in_micrometres ||
        textAttribute(dataset_.id(), "length_unit") == lengthUnitName(LengthUnit::kMillimetre))
      geometry.unit = LengthUnit::kMillimetre;
    if (is_in_micrometres)
      info_.notes.push_back("lengths were scaled from micrometres to millimetres");
    tidyGeometry(path_, geometry, info_.notes);
  }

  // The library's cache holds 1 MiB unless told otherwise: each chunk would be unpacked for every
  // row in it.
  void reopenWithCache() {
    if (chunk_bytes_ == 0) return;
    std::uint64_t layer_bytes = chunk_bytes_;
    for (int axis = 0; axis < 2; ++axis) {
      const auto edge = static_cast<std::int64_t>(
          chunk_voxels_[static_cast<std::size_t>(axis_[static_cast<std::size_t>(axis)])]);
      layer_bytes *= static_cast<std::uint64_t>((info_.voxels[axis] + edge - 1) / edge);
      if (layer_bytes > options_.memory_bytes) break;
    }
    cache_bytes_ = std::max(chunk_bytes_, std::min(2 * layer_bytes, options_.memory_bytes));
    const Hdf5Handle access(H5Pcreate(H5P_DATASET_ACCESS), H5Pclose);
    const std::size_t slots = static_cast<std::size_t>(cache_bytes_ / chunk_bytes_) * 10 + 101;
    H5Pset_chunk_cache(access.id(), slots, cache_bytes_, 1.0);
    dataset_ = {};
    dataset_ = Hdf5Handle(H5Dopen2(file_.id(), dataset_name_.c_str(), access.id()), H5Dclose);
    if (!dataset_.isValid()) throw cannotRead(path_, "its dataset cannot be opened again");
  }

  void readPart(const IndexBox& box, void* out) const {
    const std::lock_guard lock(hdf5Mutex());
    std::array<hsize_t, kMostAxes> first = fixed_, count{};
    count.fill(1);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      first[static_cast<std::size_t>(axis_[axis])] =
          static_cast<hsize_t>(box.first[static_cast<int>(axis)]);
      count[static_cast<std::size_t>(axis_[axis])] =
          static_cast<hsize_t>(box.count[static_cast<int>(axis)]);
    }
    const Hdf5Handle file_space(H5Dget_space(dataset_.id()), H5Sclose);
    const Hdf5Handle memory_space(H5Screate_simple(axes_, count.data(), nullptr), H5Sclose);
    // h5py's bools are named numbers of 8 bits: read in their own type.
    const Hdf5Handle own_type(H5Dget_type(dataset_.id()), H5Tclose);
    const hid_t type = is_enum_ ? own_type.id() : memory_type_;
    if (H5Sselect_hyperslab(file_space.id(), H5S_SELECT_SET, first.data(), nullptr, count.data(),
                            nullptr) < 0 ||
        H5Dread(dataset_.id(), type, memory_space.id(), file_space.id(), H5P_DEFAULT, out) < 0)
      throw Error("cannot read slices " + std::to_string(box.first.z) + " to " +
                      std::to_string(box.end().z - 1) + " of '" + info_.source +
                      "': the file is cut short or damaged there; get it again",
                  {.path = path_});
  }

  OpenOptions options_;
  std::string path_, dataset_name_;
  std::vector<std::string> source_files_;  // of a virtual dataset
  VolumeInfo info_;
  Hdf5Handle file_, dataset_;
  int axes_ = 0;
  std::array<int, 3> axis_{};               // which axis of the dataset x, y and z are
  std::array<hsize_t, kMostAxes> fixed_{};  // the index along all others
  std::array<hsize_t, kMostAxes> chunk_voxels_{};
  hid_t memory_type_ = H5I_INVALID_HID;
  bool is_enum_ = false;
  std::uint64_t chunk_bytes_ = 0;  // 0: not in chunks
  std::int64_t chunk_slices_ = 64;
  std::uint64_t cache_bytes_ = 0;
};

}  // namespace

std::unique_ptr<VolumeSource> openHdf5Source(const std::string& name, const OpenOptions& options) {
  return std::make_unique<Hdf5Source>(name, options);
}

}  // namespace isobrick
