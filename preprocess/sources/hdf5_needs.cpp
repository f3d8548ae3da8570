#include "isobrick/preprocess/sources/hdf5_needs.h"

#include <algorithm>
#include <array>
#include <filesystem>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/hdf5_filters.h"
#include "isobrick/preprocess/sources/source_checks.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

std::string besideOf(const std::string& path, const std::string& name) {
  return (fs::path(path).parent_path() / name).string();
}

class NeedsFinder {
 public:
  NeedsFinder(const std::string& name, const OpenOptions& options)
      : name_(name), options_(options) {}

  struct Place {
    hid_t dataset, file;
    std::string path;  // of the file
    std::string name;  // of the dataset, for messages
  };

  void check(const Place& place, int depth) {
    const Hdf5Handle creation(H5Dget_create_plist(place.dataset), H5Pclose);
    requireFilters(creation.id(), place.name);
    findRawFiles(creation.id(), place.path);
    if (H5Pget_layout(creation.id()) != H5D_VIRTUAL) return;
    constexpr int kMostDepth = 8;
    if (depth == kMostDepth)
      throw unusable(name_, "it is virtual over too many steps; copy it into one dataset");
    checkVirtual(creation.id(), place, depth);
  }

  Hdf5Needs take() { return std::move(needs_); }

 private:
  void checkVirtual(hid_t creation, const Place& place, int depth) {
    std::size_t count = 0;
    H5Pget_virtual_count(creation, &count);
    const auto textOf = [&](auto&& get, std::size_t i) {
      const ssize_t length = get(creation, i, nullptr, 0);
      std::string text(static_cast<std::size_t>(std::max<ssize_t>(length, 0)), '\0');
      if (length > 0) get(creation, i, text.data(), text.size() + 1);
      return text;
    };
    for (std::size_t i = 0; i < count; ++i) {
      options_.checkCancel();
      const std::string file = textOf(H5Pget_virtual_filename, i);
      const std::string dataset = textOf(H5Pget_virtual_dsetname, i);
      if (file.find('%') != std::string::npos || dataset.find('%') != std::string::npos)
        throw unusable(name_, "it takes its voxels from as many files as match " +
                                  quotedText(file, 100) +
                                  ", of which nobody knows whether all are there; copy it into one "
                                  "dataset");
      checkVirtualSource(file, dataset, place, depth);
    }
  }

  // Searches as the library does: beside the file, then in the working directory.
  void checkVirtualSource(const std::string& file, const std::string& dataset, const Place& user,
                          int depth) {
    const bool is_same = file == ".";
    const std::string beside = besideOf(user.path, file);
    const std::string path = is_same ? user.path : inputIsThere(beside) ? beside : file;
    if (!is_same) addFile(path, user.path);
    const Hdf5Handle opened(
        is_same ? H5I_INVALID_HID : H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose);
    const hid_t holder = is_same ? user.file : opened.id();
    const Hdf5Handle found(H5Dopen2(holder, dataset.c_str(), H5P_DEFAULT), H5Dclose);
    if (!found.isValid())
      throw unreadable(path, "it has no dataset " + quotedText(dataset, 100) + ", from which '" +
                                 user.name + "' takes its voxels; get the whole file");
    check({found.id(), holder, path, path + ":" + dataset}, depth + 1);
  }

  // The library searches them in the working directory, unless told that they lie beside.
  void findRawFiles(hid_t creation, const std::string& path) {
    const int count = H5Pget_external_count(creation);
    for (int i = 0; i < count; ++i) {
      std::array<char, 4096> text{};
      H5Pget_external(creation, static_cast<unsigned>(i), text.size() - 1, text.data(), nullptr,
                      nullptr);
      const std::string beside = besideOf(path, text.data());
      if (i == 0) needs_.raw_files_lie_beside = inputIsThere(beside);
      addFile(needs_.raw_files_lie_beside ? beside : text.data(), path);
    }
  }

  void addFile(const std::string& file, const std::string& named_by) {
    auto& files = needs_.files;
    if (std::find(files.begin(), files.end(), file) != files.end()) return;
    const InputFile check(file, named_by);  // throws the reason why it cannot be opened
    files.push_back(file);
  }

  const std::string& name_;
  const OpenOptions& options_;
  Hdf5Needs needs_;
};

}  // namespace

Hdf5Needs checkHdf5Needs(hid_t dataset, hid_t file, const std::string& path,
                         const std::string& name, const OpenOptions& options) {
  NeedsFinder finder(name, options);
  finder.check({dataset, file, path, name}, 0);
  return finder.take();
}

}  // namespace isobrick
