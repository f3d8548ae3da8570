// Which parts of which bricks a query asked for.
#pragma once

#include <tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <cstdint>
#include <vector>

#include "isobrick/storage/brick_table.h"

namespace isobrick {

// Notes may come from any thread. Grows with what is noted, not with the file.
class ReadLog {
 public:
  enum Mark : std::uint8_t { kSamples = 1, kRanges = 2, kCurvature = 4, kActive = 8 };
  static constexpr Mark markOf(PartKind kind) {
    return static_cast<Mark>(1u << static_cast<unsigned>(kind));
  }
  struct Entry {
    std::size_t brick_row = 0;
    unsigned marks = 0;
  };

  void note(std::size_t brick_row, Mark mark) {
    Notes& notes = notes_.local();
    std::vector<Entry>& entries = notes.entries;
    if (entries.size() > notes.looked_at && entries.back().brick_row == brick_row)
      entries.back().marks |= mark;
    else
      entries.push_back({brick_row, mark});
  }

  // Calls `f(brick_row)` for what this thread has noted since it was here last, at least.
  template <typename F>
  void forEachNewOfThisThread(F&& f) {
    Notes& notes = notes_.local();
    for (; notes.looked_at < notes.entries.size(); ++notes.looked_at)
      f(notes.entries[notes.looked_at].brick_row);
  }

  // Every brick that was noted once, by rows. While no thread notes.
  std::vector<Entry> entries() const {
    std::vector<Entry> all;
    for (const Notes& notes : notes_)
      all.insert(all.end(), notes.entries.begin(), notes.entries.end());
    std::sort(all.begin(), all.end(),
              [](const Entry& a, const Entry& b) { return a.brick_row < b.brick_row; });
    std::size_t kept = 0;
    for (const Entry& entry : all) {
      if (kept > 0 && all[kept - 1].brick_row == entry.brick_row)
        all[kept - 1].marks |= entry.marks;
      else
        all[kept++] = entry;
    }
    all.resize(kept);
    return all;
  }

  // Forgets all notes and keeps the memory.
  void clear() {
    for (Notes& notes : notes_) {
      notes.entries.clear();
      notes.looked_at = 0;
    }
  }

 private:
  struct Notes {
    std::vector<Entry> entries;
    std::size_t looked_at = 0;
  };
  tbb::enumerable_thread_specific<Notes> notes_;
};

}  // namespace isobrick
