// A range of memory that one thread changes while a signal handler reads it.
#pragma once

#include <atomic>
#include <cstdint>
#include <optional>

namespace isobrick {

// Holds a range or none. Reading is async-signal-safe and never waits; changes come from one thread
// at a time (hold a lock around them).
class RangeSlot {
 public:
  struct Range {
    std::uintptr_t begin = 0;
    std::uint64_t size = 0;
  };

  // A range of size 0 is none.
  void set(const Range& range) noexcept {
    version_.fetch_add(1);  // odd: the values are not valid
    begin_.store(range.begin);
    size_.store(range.size);
    version_.fetch_add(1);
  }

  // The range as it was at one moment; nothing if there is none, or if it changed while it was
  // read. (A range in use does not change, so a read because of a fault in it loses nothing.)
  std::optional<Range> read() const noexcept {
    const std::uint64_t version = version_.load();
    const Range range{begin_.load(), size_.load()};
    if (version % 2 != 0 || version_.load() != version || range.size == 0) return std::nullopt;
    return range;
  }

 private:
  std::atomic<std::uint64_t> version_{0};
  std::atomic<std::uintptr_t> begin_{0};
  std::atomic<std::uint64_t> size_{0};
  static_assert(std::atomic<std::uint64_t>::is_always_lock_free);
  static_assert(std::atomic<std::uintptr_t>::is_always_lock_free);
};

}  // namespace isobrick
