// The states in which a loss of power may leave a folder while a process changes it, from its
// record (change_record.h).
//
// A loss comes after any change. What was waited for with fsync is there. Of the rest:
//
// - kOrdered is ext4 with data=ordered: changes of names and truncations are there up to any one of
//   them, and any fsync brings all before it; of the bytes that were written, any blocks.
// - kWeak is what POSIX promises: fsync of a file brings its bytes and its size, and no name; fsync
//   of a folder brings its names. Of other changes of names any are there, of other bytes any
//   blocks, and a file may have its new size with zeros in place of its bytes.
//
// A block has 4096 bytes, or 512: then a page is torn.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "tests/faults/change_record.h"

namespace isobrick::test {

// What writeChanges() wrote. The first ones make what was there before, up to a kSyncAll.
std::vector<Change> readChanges(const std::string& file);

// The bytes of all files by their names within the folder; names of folders end in a slash.
using FolderContent = std::map<std::string, std::string>;

enum class DiskModel { kOrdered, kWeak };

struct LossCounts {
  std::uint64_t moments = 0;   // of the loss, one after each change
  std::uint64_t complete = 0;  // moments of which all states were made
  std::uint64_t states = 0, distinct = 0;
};

class PowerLoss {
 public:
  explicit PowerLoss(const std::vector<Change>& changes);

  // Those that the process made.
  std::size_t changes() const { return steps_.size() - begin_; }
  FolderContent before() const { return contentAt(begin_); }
  FolderContent after() const { return contentAt(steps_.size()); }

  // Calls `visit` with each state that differs from all before. `is_done`: the process had ended.
  // Of a moment that has more than `most_each` states so many are made, always the same.
  LossCounts visitStates(
      DiskModel model, std::uint64_t most_each,
      const std::function<void(const FolderContent& state, bool is_done)>& visit) const;

 private:
  static constexpr std::size_t kNoObject = ~std::size_t{0};
  struct Name {
    std::size_t folder;
    std::string name;
    std::size_t object;  // kNoObject: the name goes
  };
  struct Step {
    ChangeKind kind = ChangeKind::kSyncAll;  // kRename stands for all changes of names
    std::vector<Name> names;
    std::size_t object = kNoObject;
    std::uint64_t offset = 0;
    std::string bytes;
  };
  struct Object {
    bool is_folder = false;
    std::map<std::string, std::size_t> names;
    std::string bytes;
  };
  struct Pending;
  struct Choice;

  FolderContent contentAt(std::size_t moment) const;
  FolderContent contentOf(const std::vector<Object>& objects) const;
  bool isDurable(std::size_t step, std::size_t moment, DiskModel model) const;
  Pending pendingAt(std::size_t moment, DiskModel model) const;
  FolderContent stateOf(std::size_t moment, const Pending& pending, const Choice& choice) const;
  std::vector<Object> noObjects() const;
  static void apply(const Step& step, std::vector<Object>& objects);

  std::vector<bool> object_is_folder_;
  std::vector<Step> steps_;
  std::size_t begin_ = 0;  // steps before it made what was there
};

}  // namespace isobrick::test
