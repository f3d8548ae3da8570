#include "isobrick/storage/pyramid_file.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "isobrick/storage/format.h"
#include "isobrick/storage/lowercase.h"
#include "isobrick/storage/remote_options.h"

namespace isobrick {
namespace {

bool isRegularFile(const std::string& path) {
  std::error_code ignored;
  return std::filesystem::is_regular_file(path, ignored);
}

}  // namespace

bool beginsAsPyramid(const std::string& path) {
  if (!isRegularFile(path)) return false;
  char magic[sizeof format::kMagic] = {};
  std::ifstream file(path, std::ios::binary);
  return file.read(magic, sizeof magic) &&
         std::equal(std::begin(magic), std::end(magic), std::begin(format::kMagic));
}

bool isPyramidFile(const std::string& path) {
  if (isRemotePath(path)) return true;
  return isRegularFile(path) && (lowerExtension(path) == ".isb" || beginsAsPyramid(path));
}

}  // namespace isobrick
