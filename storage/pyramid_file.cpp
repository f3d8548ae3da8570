#include "isobrick/storage/pyramid_file.h"

#include <algorithm>
#include <fstream>
#include <iterator>
#include <utility>

#include "isobrick/storage/file_system.h"
#include "isobrick/storage/format.h"
#include "isobrick/storage/lowercase.h"
#include "isobrick/storage/pyramid_division.h"
#include "isobrick/storage/remote_options.h"

namespace isobrick {
namespace {

std::string withoutSlashes(std::string path) {
  while (path.size() > 1 && path.ends_with('/')) path.pop_back();
  return path;
}

// A URL without its query, and the query.
std::pair<std::string, std::string> splitQuery(const std::string& path) {
  const bool has_query = isRemotePath(path) && !isBucketPath(path);
  const std::size_t end = has_query ? path.find_first_of("?#") : std::string::npos;
  return {path.substr(0, end), end == std::string::npos ? "" : path.substr(end)};
}

}  // namespace

std::string pyramidFileOf(const std::string& path) {
  auto [place, query] = splitQuery(path);
  place = withoutSlashes(place);
  const bool has_ending = lowerExtension(place) == kDividedEnding;
  const std::string index = place + "/" + kIndexName;
  if (isRemotePath(path) ? has_ending : isFolder(path) && (has_ending || isRegularFile(index)))
    return index + query;
  return path;
}

std::string besidePath(const std::string& path, const std::string& name) {
  const auto [place, query] = splitQuery(path);
  const std::size_t slash = place.rfind('/');
  return (slash == std::string::npos ? "" : place.substr(0, slash + 1)) + name + query;
}

bool beginsAsPyramid(const std::string& path) {
  if (!isRegularFile(path)) return false;
  char magic[sizeof format::kMagic] = {};
  std::ifstream file(path, std::ios::binary);
  return file.read(magic, sizeof magic) &&
         std::equal(std::begin(magic), std::end(magic), std::begin(format::kMagic));
}

bool isRemoteVolume(const std::string& path) {
  if (!isRemotePath(path)) return false;
  const std::string place = lowercase(splitQuery(path).first);
  const std::string ending = lowerExtension(withoutSlashes(place));
  if (ending == ".isb" || ending == kDividedEnding) return false;
  const auto leadsThrough = [&](const char* name) {
    return (place + "/").find(name) != place.npos;
  };
  return place.ends_with('/') || leadsThrough(".zarr/") || leadsThrough(".ozx/") ||
         leadsThrough(".zip/");
}

bool isPyramidFile(const std::string& path) {
  if (isRemotePath(path)) return !isRemoteVolume(path);
  if (isFolder(path))
    return lowerExtension(withoutSlashes(path)) == kDividedEnding ||
           beginsAsPyramid(path + "/" + kIndexName);
  return isRegularFile(path) && (lowerExtension(path) == ".isb" || beginsAsPyramid(path));
}

}  // namespace isobrick
