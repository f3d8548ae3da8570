// Which parts of which bricks a query asked for.
#pragma once

#include <atomic>
#include <cstdint>
#include <vector>

namespace isobrick {

// One byte for every brick; notes may come from any thread.
class ReadLog {
 public:
  enum Mark : std::uint8_t { kSamples = 1, kRanges = 2, kCurvature = 4, kActive = 8 };

  explicit ReadLog(std::size_t bricks) : marks_(bricks) {}
  void note(std::size_t brick_row, Mark mark) {
    marks_[brick_row].fetch_or(mark, std::memory_order_relaxed);
  }
  bool has(std::size_t brick_row, Mark mark) const {
    return (marks_[brick_row].load(std::memory_order_relaxed) & mark) != 0;
  }
  bool hasAny(std::size_t brick_row) const {
    return marks_[brick_row].load(std::memory_order_relaxed) != 0;
  }

 private:
  std::vector<std::atomic<std::uint8_t>> marks_;
};

}  // namespace isobrick
