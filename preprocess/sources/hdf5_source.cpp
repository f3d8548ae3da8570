#include <algorithm>
#include <array>
#include <filesystem>
#include <functional>
#include <mutex>
#include <optional>
#include <tuple>
#include <vector>

#include "isobrick/preprocess/hdf5_handle.h"
#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/one_grid.h"
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
    case StoredType::kUint32:
      return H5T_NATIVE_UINT32;
    case StoredType::kInt32:
      return H5T_NATIVE_INT32;
    case StoredType::kUint64:
      return H5T_NATIVE_UINT64;
    case StoredType::kInt64:
      return H5T_NATIVE_INT64;
    case StoredType::kFloat16:
    case StoredType::kFloat32:
      return H5T_NATIVE_FLOAT;
    case StoredType::kFloat64:
      return H5T_NATIVE_DOUBLE;
  }
  return H5T_NATIVE_FLOAT;
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

constexpr int kMostAxes = 8;
constexpr std::size_t kMostDatasets = 12;  // that are listed

// Datasets of three axes or more below a group.
using DatasetNames = std::vector<std::string>;
// `Info` is what H5Ovisit2 wants: H5O_info_t until HDF5 1.10, H5O_info1_t later.
template <typename Info>
herr_t noteDataset(hid_t group, const char* name, const Info* info, void* found) {
  if (info->type != H5O_TYPE_DATASET) return 0;
  const Hdf5Handle dataset(H5Dopen2(group, name, H5P_DEFAULT), H5Dclose);
  if (!dataset.isValid()) return 0;
  const Hdf5Handle space(H5Dget_space(dataset.id()), H5Sclose);
  auto& names = *static_cast<DatasetNames*>(found);
  if (space.isValid() && H5Sget_simple_extent_ndims(space.id()) >= 3)
    names.push_back(std::string("/") + name);
  return names.size() > kMostDatasets ? 1 : 0;
}
bool findDatasets(hid_t file, DatasetNames& names) {
  return H5Ovisit2(file, H5_INDEX_NAME, H5_ITER_INC, noteDataset, &names, H5O_INFO_BASIC) >= 0;
}

// An attribute, which need not be there.
class Hdf5Attribute {
 public:
  Hdf5Attribute(hid_t object, const char* name) {
    if (H5Aexists(object, name) <= 0) return;
    attribute_ = Hdf5Handle(H5Aopen(object, name, H5P_DEFAULT), H5Aclose);
    if (!attribute_.isValid()) return;
    type_ = Hdf5Handle(H5Aget_type(attribute_.id()), H5Tclose);
    const Hdf5Handle space(H5Aget_space(attribute_.id()), H5Sclose);
    kind_ = H5Tget_class(type_.id());
    count_ = H5Sget_simple_extent_npoints(space.id());
  }

  // None if it is missing, or has not so many.
  std::vector<double> numbers(std::size_t count) const {
    const bool are_numbers = kind_ == H5T_FLOAT || kind_ == H5T_INTEGER;
    if (!are_numbers || count_ != static_cast<hssize_t>(count)) return {};
    std::vector<double> values(count);
    if (H5Aread(attribute_.id(), H5T_NATIVE_DOUBLE, values.data()) < 0) return {};
    return values;
  }

  // "" if it is missing, or no text.
  std::string text() const {
    if (kind_ != H5T_STRING || count_ != 1) return {};
    if (H5Tis_variable_str(type_.id()) > 0) {
      char* text = nullptr;
      if (H5Aread(attribute_.id(), type_.id(), &text) < 0 || text == nullptr) return {};
      std::string result(text);
      H5free_memory(text);
      return result;
    }
    constexpr std::size_t kMost = 1000;
    const std::size_t bytes = H5Tget_size(type_.id());
    std::string text(bytes, '\0');
    if (bytes > kMost || H5Aread(attribute_.id(), type_.id(), text.data()) < 0) return {};
    return text.c_str();  // up to the characters that fill it up
  }

 private:
  Hdf5Handle attribute_, type_;
  H5T_class_t kind_ = H5T_NO_CLASS;
  hssize_t count_ = 0;
};

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
    takeChunks();
    findSourceFiles();
    countMissingChunks();
    takeGeometry();
    reopenWithCache();
    options_.progress = nullptr;
  }

  const VolumeInfo& info() const override { return info_; }
  std::vector<std::string> files() const override {
    std::vector<std::string> files = {path_};
    files.insert(files.end(), source_files_.begin(), source_files_.end());
    return files;
  }
  bool readsBoxes() const override { return true; }
  std::uint64_t bufferBytes() const override { return cache_bytes_ + chunk_bytes_; }

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
    DatasetNames names;
    if (dataset_name_.empty()) {
      if (!findDatasets(file_.id(), names))
        throw cannotRead(path_, "its list of datasets is damaged");
      if (names.size() != 1)
        throw Error("which dataset of '" + path_ + "' is unclear: it has " + listOf(names) +
                        "; name one, as in " + path_ + ":/path",
                    {.path = path_});
      dataset_name_ = names.front();
    }
    dataset_ = Hdf5Handle(H5Dopen2(file_.id(), dataset_name_.c_str(), H5P_DEFAULT), H5Dclose);
    if (!dataset_.isValid()) {
      findDatasets(file_.id(), names);
      throw Error("'" + path_ + "' has no dataset " + quotedText(dataset_name_, 100) +
                      " that can be opened; it has " + listOf(names),
                  {.path = path_});
    }
    creation_ = Hdf5Handle(H5Dget_create_plist(dataset_.id()), H5Pclose);
    type_ = Hdf5Handle(H5Dget_type(dataset_.id()), H5Tclose);
    layout_ = H5Pget_layout(creation_.id());
  }

  static std::string listOf(const DatasetNames& names) {
    if (names.empty()) return "none of three axes";
    std::string text;
    for (std::size_t i = 0; i < std::min(names.size(), kMostDatasets); ++i)
      text += (i > 0 ? ", " : "") + quotedText(names[i], 100);
    return text + (names.size() > kMostDatasets ? ", ..." : "");
  }

  Error refused(const std::string& why) const {
    return Error("cannot use '" + info_.source + "': " + why, {.path = path_});
  }

  void takeShape() {
    const Hdf5Handle space(H5Dget_space(dataset_.id()), H5Sclose);
    axes_ = space.isValid() ? H5Sget_simple_extent_ndims(space.id()) : -1;
    if (axes_ < 3 || axes_ > kMostAxes ||
        H5Sget_simple_extent_dims(space.id(), dims_.data(), most_dims_.data()) != axes_)
      throw refused("its dataset has " + std::to_string(axes_) +
                    " axes, and a volume has three; name another dataset");
    // The axes of space are the last three of more than one element, or the last three.
    const auto axes = static_cast<std::size_t>(axes_);
    std::vector<std::size_t> wide;
    for (std::size_t i = 0; i < axes; ++i)
      if (dims_[i] != 1) wide.push_back(i);
    std::optional<std::size_t> further;
    if (wide.size() == 4 && options_.channel) {
      further = wide.front();
      wide.erase(wide.begin());
    }
    if (wide.size() > 3)
      throw Error("cannot use '" + info_.source + "': its dataset has " +
                      std::to_string(wide.size()) + " axes of more than one element, and three " +
                      "are read, or of four those behind an index of the first",
                  {.path = path_}, {Remedy::kChooseChannel});
    for (std::size_t i = axes; wide.size() < 3;)
      if (std::find(wide.begin(), wide.end(), --i) == wide.end()) wide.push_back(i);
    std::sort(wide.begin(), wide.end(), std::greater());
    for (std::size_t axis = 0; axis < 3; ++axis) {
      axis_[axis] = wide[axis];
      info_.voxels[static_cast<int>(axis)] =
          static_cast<std::int64_t>(std::min<hsize_t>(dims_[wide[axis]], INT64_MAX));
    }
    checkVoxelCounts(path_, info_.voxels);
    if (further) {
      const hsize_t count = dims_[*further];
      if (static_cast<hsize_t>(*options_.channel) >= count)
        throw Error("'" + info_.source + "' has the channels 0 to " + std::to_string(count - 1) +
                        ", and not " + std::to_string(*options_.channel) + "; choose one of these",
                    {.path = path_});
      fixed_[*further] = static_cast<hsize_t>(*options_.channel);
      info_.encoding = "channel " + std::to_string(*options_.channel);
    }
  }

  void takeType() {
    const auto stored = type_.isValid() ? storedTypeOf(type_.id()) : std::nullopt;
    if (!stored)
      throw refused("its voxels are no integers or floats of up to 8 bytes; convert them first");
    StoredVoxels voxels;
    voxels.type = *stored;
    info_.voxel_type = voxels.delivered();
    // h5py's bools are named numbers of 8 bits: read in their own type.
    memory_type_ = H5Tget_class(type_.id()) == H5T_ENUM ? type_.id() : memoryType(*stored);
  }

  void checkFilters() const {
    const int filters = H5Pget_nfilters(creation_.id());
    for (int i = 0; i < filters; ++i) {
      unsigned flags = 0;
      std::size_t values = 0;
      std::array<char, 80> name{};
      unsigned config = 0;
      const H5Z_filter_t filter =
          H5Pget_filter2(creation_.id(), static_cast<unsigned>(i), &flags, &values, nullptr,
                         name.size() - 1, name.data(), &config);
      if (H5Zfilter_avail(filter) > 0) continue;
      throw Error("cannot read '" + info_.source + "': its chunks are packed with the filter " +
                      std::to_string(filter) + " " + quotedText(name.data(), 60) +
                      ", which this machine's HDF5 lacks; install its plugin (hdf5-plugin or " +
                      "hdf5-filter-plugin packages, HDF5_PLUGIN_PATH), or repack with h5repack -f "
                      "GZIP=1",
                  {.path = path_});
    }
  }

  void takeChunks() {
    constexpr std::uint64_t kMostChunkBytes = std::uint64_t{1} << 30;
    if (layout_ != H5D_CHUNKED ||
        H5Pget_chunk(creation_.id(), kMostAxes, chunk_voxels_.data()) != axes_)
      return;
    chunk_bytes_ = std::max<std::uint64_t>(H5Tget_size(type_.id()), 4);
    for (std::size_t i = 0; i < static_cast<std::size_t>(axes_); ++i) {
      if (__builtin_mul_overflow(chunk_bytes_, chunk_voxels_[i], &chunk_bytes_) ||
          chunk_bytes_ > kMostChunkBytes)
        throw refused(
            "its chunks have more than 1 GiB; repack it with smaller ones (h5repack -l "
            "CHUNK=64x64x64)");
      // The library makes no chunk that is longer than a dataset of a fixed size, and reads past
      // the end of one whose damaged header states such a chunk.
      if (most_dims_[i] != H5S_UNLIMITED && chunk_voxels_[i] > most_dims_[i])
        throw cannotRead(path_, "its chunks are longer than the dataset may become");
    }
    chunk_slices_ = static_cast<std::int64_t>(chunk_voxels_[axis_[2]]);
  }

  // A virtual dataset takes its voxels from others. The library gives fill values for those that it
  // does not find.
  void findSourceFiles() {
    std::size_t count = 0;
    if (layout_ != H5D_VIRTUAL || H5Pget_virtual_count(creation_.id(), &count) < 0) return;
    const auto textOf = [&](auto&& get, std::size_t i) {
      const ssize_t length = get(creation_.id(), i, nullptr, 0);
      std::string text(static_cast<std::size_t>(std::max<ssize_t>(length, 0)), '\0');
      if (length > 0) get(creation_.id(), i, text.data(), text.size() + 1);
      return text;
    };
    for (std::size_t i = 0; i < count; ++i) {
      options_.checkCancel();
      const std::string name = textOf(H5Pget_virtual_filename, i);
      const std::string dataset = textOf(H5Pget_virtual_dsetname, i);
      if (name.find('%') != std::string::npos || dataset.find('%') != std::string::npos)
        throw refused("it takes its voxels from as many files as match " + quotedText(name, 100) +
                      ", of which nobody knows whether all are there; copy it into one dataset");
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
    for (std::size_t i = 0; i < static_cast<std::size_t>(axes_); ++i)
      if (__builtin_mul_overflow(all, (dims_[i] + chunk_voxels_[i] - 1) / chunk_voxels_[i], &all))
        return;
    if (written < all)
      info_.notes.push_back(std::to_string(all - written) + " of the " + std::to_string(all) +
                            " chunks of the dataset were never written: they have its fill value");
  }

  void takeGeometry() {
    GridGeometry& geometry = info_.geometry;
    const auto spacing = Hdf5Attribute(dataset_.id(), "spacing").numbers(3);
    const auto origin = Hdf5Attribute(dataset_.id(), "origin").numbers(3);
    const auto direction = Hdf5Attribute(dataset_.id(), "direction").numbers(9);
    const auto element_size = Hdf5Attribute(dataset_.id(), "element_size_um").numbers(3);
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
    if (is_in_micrometres || Hdf5Attribute(dataset_.id(), "length_unit").text() ==
                                 lengthUnitName(LengthUnit::kMillimetre))
      geometry.unit = LengthUnit::kMillimetre;
    if (is_in_micrometres)
      info_.notes.push_back("lengths were scaled from micrometres to millimetres");
    tidyGeometry(path_, geometry, info_.voxels, info_.notes);
  }

  // The library's cache holds 1 MiB unless told otherwise: each chunk would be unpacked for every
  // row in it.
  void reopenWithCache() {
    if (chunk_bytes_ == 0) return;
    std::uint64_t layer_bytes = chunk_bytes_;
    for (const std::size_t axis : {axis_[0], axis_[1]}) {
      layer_bytes *= (dims_[axis] + chunk_voxels_[axis] - 1) / chunk_voxels_[axis];
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
      first[axis_[axis]] = static_cast<hsize_t>(box.first[static_cast<int>(axis)]);
      count[axis_[axis]] = static_cast<hsize_t>(box.count[static_cast<int>(axis)]);
    }
    const Hdf5Handle file_space(H5Dget_space(dataset_.id()), H5Sclose);
    const Hdf5Handle memory_space(H5Screate_simple(axes_, count.data(), nullptr), H5Sclose);
    if (H5Sselect_hyperslab(file_space.id(), H5S_SELECT_SET, first.data(), nullptr, count.data(),
                            nullptr) < 0 ||
        H5Dread(dataset_.id(), memory_type_, memory_space.id(), file_space.id(), H5P_DEFAULT, out) <
            0)
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
  Hdf5Handle creation_, type_;  // of the dataset
  H5D_layout_t layout_ = H5D_CONTIGUOUS;
  int axes_ = 0;
  std::array<hsize_t, kMostAxes> dims_{}, most_dims_{};
  std::array<std::size_t, 3> axis_{};       // which axis of the dataset x, y and z are
  std::array<hsize_t, kMostAxes> fixed_{};  // the index along all others
  std::array<hsize_t, kMostAxes> chunk_voxels_{};
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
