// Names of files: the entries of a folder, the volumes opened last, and what the viewer writes.
#pragma once

#include <functional>
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

// Regular files and folders, links to them included. Throws Error if the folder cannot be read, and
// Cancelled.
FolderListing listFolder(const std::string& folder, const CancelFlag& cancel);

// Bytes of any origin as one line of UTF-8: bytes that are none, and characters that could move a
// cursor, become '?'.
std::string shownName(const std::string& bytes);

inline constexpr std::size_t kMostRecentFiles = 12;

// The list, latest first, with `path` at its head and nowhere else. An entry that a list cannot
// keep, a path that is not absolute or has control characters in it, leaves it as it was.
std::vector<std::string> withRecent(std::vector<std::string> recent, const std::string& path);

// Absolute paths, one a line, as the file has them: at most kMostRecentFiles. An entry that is no
// such path is left out.
std::vector<std::string> recentFromText(std::string_view text);
std::string recentToText(const std::vector<std::string>& recent);

// The path of the list: isobrick/recent in $XDG_STATE_HOME, or in ~/.local/state. Empty if neither
// is defined.
std::string recentFilesPath();
// Neither throws: a list that cannot be read is empty, and one that cannot be written is lost. At
// most 64 KiB are read, from a regular file.
std::vector<std::string> readRecentFiles(const std::string& path);
void writeRecentFiles(const std::string& path, const std::vector<std::string>& recent);

// The name of a volume's files: "scan" for "scans/scan.nii.gz", "head-256" for "phantom:head:256".
std::string stemOf(const std::string& source);

// A path as the user would write it: with ~ for the folder that $HOME names.
std::string shortPath(const std::string& path);

// The first name STEM-0001.png, STEM-0002.png, ... that no file has, and that `isTaken` does not
// claim. Throws Error if there is none.
std::string freeName(const std::string& stem, const char* extension,
                     const std::function<bool(const std::string&)>& isTaken = {});

}  // namespace isobrick
