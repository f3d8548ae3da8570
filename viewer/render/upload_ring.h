// Which parts of a ring of memory are free that the processor writes and the graphics card reads
// later.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <optional>

namespace isobrick {

// Knows no memory and no OpenGL: only places in it, and when they are free again. Belongs to one
// thread. Never waits.
class UploadRing {
 public:
  // True once the card has done all that it was told before the fence; not asked afterwards.
  using Fence = std::function<bool()>;

  explicit UploadRing(std::size_t bytes) : bytes_(bytes) {}

  // Where `bytes`, at most those of the ring, may be written in one run, a multiple of 16; nothing
  // while the card may still read there: ask again in the next frame.
  std::optional<std::size_t> take(std::size_t bytes);
  // The card was told to read all that was taken since the last call, and `fence` comes after that.
  void close(Fence fence);
  // Something was taken since then.
  bool isOpen() const { return head_ != closed_; }

 private:
  struct Region {
    std::uint64_t end = 0;
    Fence fence;
  };
  void reclaim();

  const std::size_t bytes_;
  // All bytes ever taken, with what was left at the ring's end; where a place is, is the rest of a
  // division by the ring's size.
  std::uint64_t head_ = 0, closed_ = 0, tail_ = 0;
  std::deque<Region> regions_;  // told to the card, from the oldest
};

}  // namespace isobrick
