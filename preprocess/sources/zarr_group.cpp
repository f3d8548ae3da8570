#include "isobrick/preprocess/sources/zarr_group.h"

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <vector>

#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/shallow_json.h"
#include "isobrick/preprocess/sources/slice_names.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/preprocess/sources/zarr_array.h"
#include "isobrick/preprocess/sources/zarr_store.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

// What OME-Zarr says of a group, whichever the version.
const Json& omeMember(const Json& attributes, const char* key) {
  const Json& ome = member(attributes, "ome");
  return member(ome.is_object() ? ome : attributes, key);
}

// The metadata of an array; null if the folder is none.
Json arrayOf(const std::string& folder) {
  if (storeFileIsThere(folder + "/zarr.json")) {
    Json json = readZarrJson(folder + "/zarr.json");
    return textOf(member(json, "node_type")) == "array" ? json : Json();
  }
  return storeFileIsThere(folder + "/.zarray") ? readZarrJson(folder + "/.zarray") : Json();
}

// Names below a group, and no more than any store has that was not made for it.
class ZarrVolumes {
 public:
  explicit ZarrVolumes(std::string root) : root_(std::move(root)) { collect("", 0); }

  const std::vector<std::string>& names() const { return names_; }

 private:
  static constexpr std::size_t kMostGroups = 20000;
  static constexpr int kDeepest = 5;

  std::string folderOf(const std::string& name) const {
    return name.empty() ? root_ : root_ + "/" + name;
  }

  void collect(const std::string& name, int depth) {
    if (++groups_ > kMostGroups || depth > kDeepest) return;
    const std::string folder = folderOf(name);
    const Json attributes = zarrAttributes(folder);
    const Json array = arrayOf(folder);
    if (!array.is_null()) {
      if (member(array, "shape").size() >= 3) names_.push_back(name);
    } else if (!multiscalesOf(attributes).is_null()) {
      names_.push_back(name);
    } else {
      for (const std::string& child : childrenOf(folder, attributes))
        collect(name.empty() ? child : name + "/" + child, depth + 1);
    }
  }

  static std::vector<std::string> childrenOf(const std::string& folder, const Json& attributes) {
    std::vector<std::string> names;
    const auto take = [&](const Json& list, const char* key) {
      for (const Json& one : list) {
        std::string name = textOf(key == nullptr ? one : member(one, key));
        if (leadsDown(name)) names.push_back(std::move(name));
      }
    };
    if (!omeMember(attributes, "bioformats2raw.layout").is_null())
      take(omeMember(zarrAttributes(folder + "/OME"), "series"), nullptr);
    take(member(omeMember(attributes, "plate"), "wells"), "path");
    take(member(omeMember(attributes, "well"), "images"), "path");
    take(omeMember(attributes, "labels"), nullptr);
    if (!names.empty()) return names;
    visitStoreFolders(folder, [&](std::string name) {
      names.push_back(std::move(name));
      return names.size() < kMostGroups;
    });
    std::sort(names.begin(), names.end(), numericNameLess);
    return names;
  }

  std::string root_;
  std::vector<std::string> names_;
  std::size_t groups_ = 0;
};

}  // namespace

Json zarrAttributes(const std::string& folder) {
  if (storeFileIsThere(folder + "/zarr.json"))
    return member(readZarrJson(folder + "/zarr.json"), "attributes");
  if (storeFileIsThere(folder + "/.zattrs")) return readZarrJson(folder + "/.zattrs");
  return {};
}

Json multiscalesOf(const Json& attributes) {
  const Json& list = omeMember(attributes, "multiscales");
  return list.is_array() && !list.empty() ? list : Json();
}

bool leadsDown(const std::string& name) {
  if (name.empty() || name.front() == '/' || name.size() > 1000) return false;
  for (const unsigned char c : name)
    if (c < ' ' || c == '\\') return false;
  for (const fs::path& part : fs::path(name))
    if (part == ".." || part == ".") return false;
  return true;
}

std::string chooseZarrVolume(const std::string& folder, std::optional<std::int64_t> number) {
  if (!arrayOf(folder).is_null() || !multiscalesOf(zarrAttributes(folder)).is_null()) return folder;
  const ZarrVolumes volumes(folder);
  const std::vector<std::string>& names = volumes.names();
  if (names.empty())
    throw unusable(folder,
                   "it is a Zarr group with neither an image nor an array of three axes; name the "
                   "folder of one");
  if (!number && names.size() > 1)
    throw unusable(folder, "it holds " + std::to_string(names.size()) +
                               " images or arrays: " + quotedList(names) + "; name one, as in '" +
                               folder + "/" + names.front() + "'");
  if (number && static_cast<std::uint64_t>(*number) >= names.size())
    throw unusable(folder, "it has no image " + std::to_string(*number) + "; it has " +
                               quotedList(names) + ", counted from 0");
  return folder + "/" + names[static_cast<std::size_t>(number.value_or(0))];
}

}  // namespace isobrick
