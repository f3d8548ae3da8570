#include "isobrick/viewer/session/output_names.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <filesystem>

#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/remote_options.h"

namespace isobrick {

std::string stemOf(const std::string& source) {
  namespace fs = std::filesystem;
  if (isRemotePath(source))
    return fs::path(source.substr(0, source.find_first_of("?#"))).stem().string();
  if (source.rfind("phantom:", 0) == 0) {
    std::string name = source.substr(source.find(':') + 1);
    std::replace(name.begin(), name.end(), ':', '-');
    return name;
  }
  fs::path path = source;
  if (!path.has_filename()) path = path.parent_path();
  if (path.extension() == ".gz") path = path.stem();
  return path.stem().string();
}

std::string shortPath(const std::string& path) {
  const char* const home = std::getenv("HOME");
  std::string folder = home != nullptr ? home : "";
  if (folder.size() < 2) return path;
  folder += '/';
  if (path.rfind(folder, 0) != 0) return path;
  std::string shown = "~/";
  shown += path.substr(folder.size());
  return shown;
}

std::string freeName(const std::string& stem, const char* extension,
                     const std::function<bool(const std::string&)>& isTaken) {
  for (int number = 1; number < 10000; ++number) {
    std::array<char, 16> digits{};
    std::snprintf(digits.data(), digits.size(), "-%04d", number);
    const std::string name = stem + digits.data() + extension;
    if (!isPresent(name) && !(isTaken && isTaken(name))) return name;
  }
  throw Error("all names from '" + stem + "-0001" + extension + "' on are taken; move some away");
}

}  // namespace isobrick
