// Which parts of a mapped file the process holds, and for how long.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <new>
#include <vector>

#include "isobrick/storage/format.h"
#include "isobrick/storage/mapped_file.h"

namespace isobrick {

// Hands out pieces of a mapped file, each checked against its checksum when it comes in, and keeps
// the sum of those that stay resident within a budget: the piece that was let go longest ago goes
// first. Pieces in use never go, so a budget smaller than what is in use at one moment is exceeded
// by just that, and nothing waits.
//
// A stored piece is used in place: what it costs is its pages of the map, which are given back to
// the system. A packed piece is unpacked into a buffer of the heap: what it costs is that buffer
// (rounded up by at most an eighth), and, while it is being unpacked, a copy of its packed bytes,
// on which alone checksum and decoder work. The buffer of a piece that goes is passed on to the one
// that comes in, if it fits; no buffer is kept for later, so there is nothing beside the budget.
// Unpacking itself takes up to 3 MiB for each thread in it.
//
// All members are thread-safe. Reading, checking and unpacking happen outside the lock.
class BrickPager {
 public:
  struct Piece {
    std::uint64_t offset = 0;
    std::uint64_t bytes = 0;  // in the file; 0: nothing is stored; never acquired
    std::uint64_t checksum = 0;
    std::uint32_t unpacked_bytes = 0;  // of a packed piece
    format::Codec codec = format::Codec::kStored;
  };
  struct Counters {
    std::uint64_t pieces_read = 0;  // how often a piece came in
    std::uint64_t bytes_read = 0;   // of the file
    std::uint64_t bytes_unpacked = 0;
    std::uint64_t pieces_released = 0;  // how often one went for the budget
    std::uint64_t buffers_reused = 0;   // how often its buffer was passed on
  };

  BrickPager(const MappedFile& file, std::vector<Piece> pieces, std::uint64_t budget_bytes);

  // Makes piece `id` resident and keeps it so until release(id); counts nest. The memory, aligned
  // to 64 bytes where the piece is, stays valid that long; of a packed piece also unchanged, of a
  // stored one as long as nobody writes to the file. Returns nullptr where the bytes are damaged or
  // cannot be read: `*why` says which.
  [[nodiscard]] const std::byte* acquire(std::size_t id, const char** why);
  void release(std::size_t id) noexcept;

  Counters counters() const;
  // What counts against the budget now.
  std::uint64_t heldBytes() const;

 private:
  static constexpr std::uint32_t kNone = ~std::uint32_t{0};
  static constexpr std::align_val_t kBufferAlignment{format::kPartAlignment};

  struct BufferDeleter {
    void operator()(std::byte* p) const { ::operator delete[](p, kBufferAlignment); }
  };
  struct Buffer {
    std::unique_ptr<std::byte[], BufferDeleter> data;
    std::uint32_t bytes = 0;
  };
  struct State {
    std::uint32_t users = 0;
    std::uint32_t newer = kNone, older = kNone;  // neighbours in the queue of unused pieces
    bool resident = false;
    Buffer unpacked;  // of a resident packed piece
  };

  const std::byte* holdResident(std::size_t id);
  const std::byte* bringInStored(std::size_t id, const char** why);
  const std::byte* bringInPacked(std::size_t id, const char** why);
  bool unpackPiece(const Piece& piece, std::byte* out, const char** why) const;

  // All of these with the lock held.
  const std::byte* dataOf(std::size_t id) const;
  const std::byte* addUser(std::size_t id);  // of a resident piece
  const std::byte* makeResident(std::size_t id, Buffer unpacked);
  Buffer makeRoom(const Piece& piece);
  Buffer evictOldest();
  void evictOverBudget();
  void unlink(std::size_t id);

  const MappedFile& file_;
  const std::vector<Piece> pieces_;
  const std::uint64_t budget_bytes_;
  mutable std::mutex mutex_;  // guards all below
  std::vector<State> states_;
  std::uint32_t newest_ = kNone, oldest_ = kNone;
  std::uint64_t held_bytes_ = 0;
  Counters counters_;
};

}  // namespace isobrick
