// The entries of a folder, for people who choose from it.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "isobrick/storage/error.h"

namespace isobrick {

struct FolderEntry {
  std::string name;  // bytes, as the system has them
  bool is_folder = false;

  bool operator==(const FolderEntry&) const = default;
};
struct FolderListing {
  std::string folder;                // absolute
  std::vector<FolderEntry> entries;  // folders first, each by name; hidden ones left out
  bool cut = false;                  // there are more than kMostFolderEntries
};
inline constexpr std::size_t kMostFolderEntries = 4000;

// Regular files and folders, links to them included. Throws Error where the folder cannot be read,
// and Cancelled.
FolderListing listFolder(const std::string& folder, const CancelFlag& cancel);

// Bytes from anywhere as one line of UTF-8: what is none, and what could move a cursor, becomes
// '?'.
std::string shownName(const std::string& bytes);

inline constexpr std::size_t kMostRecentFiles = 12;

// The list, latest first, with `path` at its head and nowhere else. An entry that a list cannot
// keep, a path that is not absolute or has control characters in it, leaves it as it was.
std::vector<std::string> withRecent(std::vector<std::string> recent, const std::string& path);

// Absolute paths, one a line, as the file has them: at most kMostRecentFiles. An entry that is no
// such path is left out, whoever wrote it.
std::vector<std::string> recentFromText(std::string_view text);
std::string recentToText(const std::vector<std::string>& recent);

// Where the list lies: isobrick/recent in $XDG_STATE_HOME, or in ~/.local/state. Empty where there
// is no such folder to be named.
std::string recentFilesPath();
// Neither throws: a list that cannot be read is empty, and one that cannot be written is lost. At
// most 64 KiB are read, from a regular file.
std::vector<std::string> readRecentFiles(const std::string& path);
void writeRecentFiles(const std::string& path, const std::vector<std::string>& recent);

}  // namespace isobrick
