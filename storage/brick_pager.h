// Which parts of a mapped file the process holds, and for how long.
#pragma once

#include <atomic>
#include <cstdint>
#include <mutex>
#include <vector>

#include "storage/mapped_file.h"

namespace isobrick {

// Hands out pieces of a mapped file, each checked against its checksum when it comes in, and keeps
// the sum of those that stay resident within a budget: the piece that was let go longest ago is
// given back to the system first. Pieces in use are never given back, so a budget smaller than what
// is in use at one moment is exceeded by just that, and nothing waits.
//
// All members are thread-safe.
class BrickPager {
 public:
  struct Piece {
    std::uint64_t offset = 0;
    std::uint64_t bytes = 0;  // 0: nothing is stored; never acquired
    std::uint64_t checksum = 0;
  };
  struct Counters {
    std::uint64_t pieces_read = 0;  // how often a piece came in
    std::uint64_t bytes_read = 0;
    std::uint64_t pieces_released = 0;  // how often one was given back for the budget
  };

  BrickPager(const MappedFile& file, std::vector<Piece> pieces, std::uint64_t budget_bytes);

  // Makes piece `id` resident and keeps it so until release(id); counts nest. The memory stays
  // valid that long. Returns nullptr where the bytes are damaged or cannot be read: `*why` says
  // which.
  [[nodiscard]] const std::byte* acquire(std::size_t id, const char** why);
  void release(std::size_t id) noexcept;

  Counters counters() const;

 private:
  static constexpr std::uint32_t kNone = ~std::uint32_t{0};
  struct State {
    std::uint32_t users = 0;
    std::uint32_t newer = kNone, older = kNone;  // neighbours in the queue of unused pieces
    bool resident = false;
  };

  void unlink(std::size_t id);
  void evictOverBudget();

  const MappedFile& file_;
  const std::vector<Piece> pieces_;
  const std::uint64_t budget_bytes_;
  mutable std::mutex mutex_;  // guards all below
  std::vector<State> states_;
  std::uint32_t newest_ = kNone, oldest_ = kNone;
  std::uint64_t resident_bytes_ = 0;
  Counters counters_;
};

}  // namespace isobrick
