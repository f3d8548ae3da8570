#include "isobrick/preprocess/sources/slice_names.h"

#include <algorithm>
#include <cctype>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string_view>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {

namespace fs = std::filesystem;

namespace {

bool beginsAsDicom(const fs::path& path) {
  constexpr std::streamoff kPreambleBytes = 128;
  std::ifstream file(path, std::ios::binary);
  char magic[4] = {};
  return file.seekg(kPreambleBytes) && file.read(magic, sizeof magic) &&
         std::string_view(magic, sizeof magic) == "DICM";
}

}  // namespace

std::vector<std::string> filesInFolder(const std::string& folder) {
  std::vector<std::string> files;
  const std::error_code failure = visitFolder(folder, [&](const FolderMember& member) {
    if (member.isRegularFile())
      files.push_back(member.path().string());
    else if (!member.isFolder() && !member.name().starts_with('.'))
      static_cast<void>(InputFile(member.path().string()));  // refuses: a slice would be missing
    return true;
  });
  if (failure)
    throw Error(
        "cannot read the folder '" + folder + "': " + failure.message() + "; check its permissions",
        {.path = folder});
  std::sort(files.begin(), files.end());
  return files;
}

bool numericNameLess(const std::string& a, const std::string& b) {
  const auto isDigit = [](char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; };
  std::size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (isDigit(a[i]) && isDigit(b[j])) {
      while (i < a.size() && a[i] == '0') ++i;
      while (j < b.size() && b[j] == '0') ++j;
      const std::size_t first_i = i, first_j = j;
      while (i < a.size() && isDigit(a[i])) ++i;
      while (j < b.size() && isDigit(b[j])) ++j;
      if (i - first_i != j - first_j) return i - first_i < j - first_j;
      const int order = a.compare(first_i, i - first_i, b, first_j, j - first_j);
      if (order != 0) return order < 0;
    } else {
      if (a[i] != b[j]) return a[i] < b[j];
      ++i;
      ++j;
    }
  }
  if (i == a.size() && j == b.size()) return a < b;  // "01" and "1": any fixed order
  return i == a.size();
}

bool hasExrSlices(const std::string& folder) {
  std::int64_t exr = 0, others = 0;
  visitFolder(folder, [&](const FolderMember& member) {
    const std::string ending = lowerExtension(member.path());
    if (ending == ".exr") ++exr;
    if (ending == ".tif" || ending == ".tiff" || ending == ".png") ++others;
    return true;
  });
  if (exr == 0) return false;
  // A stray picture does not decide the kind of a folder.
  visitFolder(folder, [&](const FolderMember& member) {
    if (member.isRegularFile() && beginsAsDicom(member.path())) ++others;
    return true;
  });
  return exr > others;
}

}  // namespace isobrick
