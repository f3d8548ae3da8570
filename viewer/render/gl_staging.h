// Memory that the processor writes and the graphics card copies from later.
#pragma once

#include "isobrick/viewer/render/gl_handle.h"
#include "isobrick/viewer/render/upload_ring.h"

namespace isobrick {

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
