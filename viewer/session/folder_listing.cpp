#include "isobrick/viewer/session/folder_listing.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <fstream>
#include <system_error>

#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/pyramid_file.h"
#include "isobrick/storage/remote_options.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

// Bytes of the character that begins at `at`; 0 if none does. Overlong forms, surrogates and codes
// beyond U+10FFFF are none.
std::size_t characterBytes(const std::string& text, std::size_t at) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned first = byte(at);
  if (first < 0x80) return 1;
  const std::size_t bytes = first >= 0xf0 ? 4 : first >= 0xe0 ? 3 : first >= 0xc0 ? 2 : 0;
  if (bytes == 0 || first > 0xf4 || at + bytes > text.size()) return 0;
  std::uint32_t code = first & (0x7fu >> bytes);
  for (std::size_t i = 1; i < bytes; ++i) {
    if ((byte(at + i) & 0xc0u) != 0x80u) return 0;
    code = code << 6 | (byte(at + i) & 0x3fu);
  }
  constexpr std::uint32_t kLeast[] = {0, 0, 0x80, 0x800, 0x10000};
  if (code < kLeast[bytes] || code > 0x10ffff || (code >= 0xd800 && code < 0xe000)) return 0;
  // C1 controls, and marks that turn the direction of writing round.
  if (code < 0xa0 || (code >= 0x202a && code <= 0x202e) || (code >= 0x2066 && code <= 0x2069))
    return 0;
  return bytes;
}

bool canBeKept(std::string_view path) {
  constexpr std::size_t kLongest = 4095;  // the system's limit
  return !path.empty() && path.front() == '/' && path.size() <= kLongest &&
         std::none_of(path.begin(), path.end(),
                      [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; });
}

// Ignores relative paths, as the base directory specification says.
fs::path folderNamed(const char* variable) {
  const char* const value = std::getenv(variable);
  return value != nullptr && *value == '/' ? fs::path(value) : fs::path();
}

}  // namespace

FolderListing listFolder(const std::string& folder, const CancelFlag& cancel) {
  FolderListing listing;
  const fs::path whole = absolutePath(folder.empty() ? "." : folder);
  listing.folder = whole.has_filename() || whole == whole.root_path()
                       ? whole.string()
                       : whole.parent_path().string();
  const std::error_code failure = visitFolder(listing.folder, [&](const FolderMember& member) {
    cancel.check();
    const std::string name = member.name();
    const bool is_folder = member.isFolder();
    if (name.front() == '.' || (!is_folder && !member.isRegularFile())) return true;
    listing.cut = listing.entries.size() == kMostFolderEntries;
    if (!listing.cut)
      listing.entries.push_back({name, is_folder && !isPyramidFile(member.path().string())});
    return !listing.cut;
  });
  if (failure)
    throw Error(
        "cannot list '" + listing.folder + "': " + failure.message() + "; choose another folder",
        {.path = listing.folder});
  std::sort(listing.entries.begin(), listing.entries.end(),
            [](const FolderEntry& a, const FolderEntry& b) {
              return std::forward_as_tuple(!a.is_folder, a.name) <
                     std::forward_as_tuple(!b.is_folder, b.name);
            });
  return listing;
}

std::string shownName(const std::string& bytes) {
  std::string shown;
  for (std::size_t at = 0; at < bytes.size();) {
    const std::size_t count = characterBytes(bytes, at);
    const bool control = count == 1 && (bytes[at] < ' ' || bytes[at] == 0x7f);
    if (count == 0 || control)
      shown += '?';
    else
      shown.append(bytes, at, count);
    at += std::max<std::size_t>(count, 1);
  }
  return shown;
}

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
  if (!isRegularFile(path)) return {};
  std::string text(std::size_t{1} << 16, '\0');
  std::ifstream file(path, std::ios::binary);
  file.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(std::max<std::streamsize>(file.gcount(), 0)));
  return recentFromText(text);
}

void writeRecentFiles(const std::string& path, const std::vector<std::string>& recent) try {
  if (path.empty()) return;
  if (makeFolders(fs::path(path).parent_path())) return;
  const std::string text = recentToText(recent);
  AtomicFile file(path);
  file.write(text.data(), text.size());
  file.commit();
} catch (const std::exception&) {  // the volume is open all the same
}

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
