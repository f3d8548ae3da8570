#include "isobrick/viewer/session/recent_files.h"

#include <algorithm>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <fstream>

#include "isobrick/storage/atomic_file.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

bool canBeKept(std::string_view path) {
  constexpr std::size_t kLongest = 4095;  // what the system takes
  return !path.empty() && path.front() == '/' && path.size() <= kLongest &&
         std::none_of(path.begin(), path.end(),
                      [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; });
}

// Relative paths are to be ignored, as the base directory specification has it.
fs::path folderNamed(const char* variable) {
  const char* const value = std::getenv(variable);
  return value != nullptr && *value == '/' ? fs::path(value) : fs::path();
}

}  // namespace

std::vector<std::string> withRecent(std::vector<std::string> recent, const std::string& path) {
  if (!canBeKept(path)) return recent;
  recent.erase(std::remove(recent.begin(), recent.end(), path), recent.end());
  recent.insert(recent.begin(), path);
  recent.resize(std::min(recent.size(), kMostRecentFiles));
  return recent;
}

std::vector<std::string> recentFromText(std::string_view text) {
  std::vector<std::string> recent;
  while (!text.empty() && recent.size() < kMostRecentFiles) {
    const std::string_view line = text.substr(0, text.find('\n'));
    text.remove_prefix(std::min(text.size(), line.size() + 1));
    if (canBeKept(line) && std::find(recent.begin(), recent.end(), line) == recent.end())
      recent.emplace_back(line);
  }
  return recent;
}

std::string recentToText(const std::vector<std::string>& recent) {
  std::string text;
  for (const std::string& path : recent) text += path + "\n";
  return text;
}

std::string recentFilesPath() {
  fs::path folder = folderNamed("XDG_STATE_HOME");
  if (folder.empty()) {
    folder = folderNamed("HOME");
    if (folder.empty()) return {};
    folder /= ".local/state";
  }
  return (folder / "isobrick" / "recent").string();
}

std::vector<std::string> readRecentFiles(const std::string& path) {
  std::error_code ignored;
  if (!fs::is_regular_file(path, ignored)) return {};
  std::string text(std::size_t{1} << 16, '\0');
  std::ifstream file(path, std::ios::binary);
  file.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(std::max<std::streamsize>(file.gcount(), 0)));
  return recentFromText(text);
}

void writeRecentFiles(const std::string& path, const std::vector<std::string>& recent) try {
  if (path.empty()) return;
  fs::create_directories(fs::path(path).parent_path());
  const std::string text = recentToText(recent);
  AtomicFile file(path);
  file.write(text.data(), text.size());
  file.commit();
} catch (const std::exception&) {  // what was opened is there all the same
}

}  // namespace isobrick
