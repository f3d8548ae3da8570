// What lies in a folder, for people who choose from it.
#pragma once

#include <string>
#include <vector>

#include "isobrick/storage/cancel.h"

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

}  // namespace isobrick
