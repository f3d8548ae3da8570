// All changes that a process makes in a folder, in their order, as a file: isobrick_with_faults
// writes it (record:PATH), power_loss.h reads it.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace isobrick::test {

enum class ChangeKind : std::uint64_t {
  kFolder,    // `path` is made
  kFile,      // the same, empty
  kLink,      // `other` becomes a second name of `path`
  kRename,    // `path` becomes `other`, whose old file goes
  kExchange,  // both take the other's place
  kRemove,    // the name `path` goes
  kWrite,     // `other` are the bytes, at `offset`
  kTruncate,  // `offset` is the new size
  kSync,      // fsync: waits for a file, or for the names in a folder
  kSyncAll,   // syncfs
};

struct Change {
  ChangeKind kind = ChangeKind::kSyncAll;
  std::uint64_t node = 0;  // inode of what is made, written to or synced
  std::uint64_t offset = 0;
  std::string path, other;  // names within the folder, which is ""
};

// From here on changes in the current folder are noted, also those that libraries make, until
// writeChanges(). For one process: functions of the C library are defined anew.
void beginChanges();
void writeChanges(const std::string& file);

}  // namespace isobrick::test
