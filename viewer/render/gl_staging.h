// Memory that the processor writes and the graphics card copies from later.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <optional>

#include "isobrick/viewer/render/gl_handle.h"

namespace isobrick {

// Uses no memory and no OpenGL: it handles only places in the ring, and when they are free again.
// Belongs to one thread. Never waits.
class UploadRing {
 public:
  // True once the card has done all commands before the fence; not called afterwards.
  using Fence = std::function<bool()>;

  explicit UploadRing(std::size_t bytes) : bytes_(bytes) {}

  // The place at which `bytes`, at most those of the ring, may be written in one run, a multiple of
  // 16; nothing while the card may still read there: call it again in the next frame.
  std::optional<std::size_t> take(std::size_t bytes);
  // The card has commands to read all bytes taken since the last call, and `fence` comes after
  // these.
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
  // All bytes ever taken, unused ones at the ring's end included; a place is the rest of a division
  // by the ring's size.
  std::uint64_t head_ = 0, closed_ = 0, tail_ = 0;
  std::deque<Region> regions_;  // that the card reads, from the oldest
};

// A ring that stays mapped, with a fence after each frame's copies. Made, used and destroyed on the
// thread on which its context is current.
class GlStaging {
 public:
  GlStaging();

  // Without it nothing can be copied: the driver had no memory for it.
  bool isThere() const { return map_ != nullptr; }
  // Copies at most kPieceBytes to `offset` of a buffer; false, and nothing done, while the ring is
  // full.
  bool copy(const void* data, std::size_t bytes, GLuint buffer, std::size_t offset);
  // After the last copy of a frame.
  void endFrame();

 private:
  GlBuffer buffer_;
  std::byte* map_ = nullptr;
  UploadRing ring_;
};

}  // namespace isobrick
