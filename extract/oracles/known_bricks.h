// What is known of bricks, for many threads that ask all the time.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>

namespace isobrick {

// A small table of facts that never change: asking takes no lock, so threads do not wait for each
// other. A brick may push out another one, of which nothing is known here then. Any thread asks,
// one at a time notes.
class KnownBricks {
 public:
  // Bits.
  enum Facts : std::uint64_t { kNothing = 0, kUsable = 1, kUnusable = 2, kRefused = 4 };

  // Of a brick, by its row of the brick table.
  std::uint64_t of(std::size_t row) const {
    const std::uint64_t entry = entries_[row % kPlaces].load(std::memory_order_acquire);
    return entry >> kFactBits == row + 1 ? entry & kFactMask : std::uint64_t{kNothing};
  }
  // In place of what was known of it.
  void note(std::size_t row, std::uint64_t facts) {
    entries_[row % kPlaces].store((std::uint64_t{row} + 1) << kFactBits | facts,
                                  std::memory_order_release);
  }

 private:
  static constexpr std::size_t kPlaces = 2048;
  static constexpr int kFactBits = 3;
  static constexpr std::uint64_t kFactMask = (std::uint64_t{1} << kFactBits) - 1;

  std::array<std::atomic<std::uint64_t>, kPlaces> entries_{};  // the row + 1, and the facts below
};

}  // namespace isobrick
