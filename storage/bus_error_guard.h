// Pages of mapped files that cannot be read: zeros and a note in place of a crash.
#pragma once

#include <atomic>
#include <cstddef>
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

// Guards one range of mapped memory. Touching a page that cannot be read (the file was cut, its
// disk failed) raises SIGBUS. The handler puts a page of zeros there, notes the place, and the
// instruction that touched it goes on. So a caller that used guarded memory calls failedOffset()
// before it uses the result. The zeros stay until the memory is mapped anew. The notes take a bit
// for each page; only pages of this memory that have a note are resident.
//
// The handler belongs to the process. The first guard() installs it and it stays to the end. Other
// signals go to the action that was installed before it, as the kernel would deliver them: to a
// handler with its mask and flags (but for SA_ONSTACK: the alternate stack is used if the thread
// has one), to none if they may be ignored, or to the default, which ends the process as if this
// handler did not exist. After a foreign fault that another handler repaired ours is still in
// place.
//
// A handler that another library installs later (a JVM, Python's faulthandler) would get our
// faults. Therefore guard() and keepInFront() put ours in front of it again; it then gets foreign
// signals, and if it passes them on to the action that it found, they reach the handlers before it.
// Two gaps remain: a fault after a later handler came and before the next guard() or keepInFront()
// is for that handler, and so is every one after kMostHandlers different handlers have come.
//
// Thread-safety: guards of different objects may begin, end and fail at once in any threads. One
// object is used by one thread at a time, but for failedOffset(). The handler's work is
// async-signal-safe; nothing else here is to be called from a signal handler.
class BusErrorGuard {
 public:
  static constexpr std::size_t kMostRanges = 2048;
  static constexpr std::size_t kMostHandlers = 16;

  BusErrorGuard() = default;
  ~BusErrorGuard() { leave(); }
  BusErrorGuard(const BusErrorGuard&) = delete;
  BusErrorGuard& operator=(const BusErrorGuard&) = delete;

  // Guards `size` bytes (at least 1) from `begin`, which begin a page, and the rest of their last
  // page. Guards nothing and returns false if kMostRanges are guarded already, or if there is no
  // address space for the notes. Call it once the memory is mapped, and leave() before it is
  // unmapped; no thread may touch the memory during these calls.
  [[nodiscard]] bool guard(const void* begin, std::uint64_t size);
  void leave() noexcept;

  // The offset, from the begin of the range, of the page that was the first that could not be read.
  std::optional<std::uint64_t> failedOffset() const noexcept;
  // The same for the lowest page of [offset, offset + bytes) that could not be read, which lies
  // within the range; `bytes` is at least 1. Costs next to nothing if none failed.
  std::optional<std::uint64_t> failedOffset(std::uint64_t offset,
                                            std::uint64_t bytes) const noexcept;

  // Costs one system call if the handler is in front.
  static void keepInFront() noexcept;

 private:
  static constexpr std::size_t kNone = ~std::size_t{0};
  std::size_t slot_ = kNone;
};

}  // namespace isobrick
