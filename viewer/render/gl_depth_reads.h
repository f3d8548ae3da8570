// Depths on their way from the card: each in a buffer of its own, with a fence behind it.
#pragma once

#include <cstdint>
#include <deque>
#include <glm/vec2.hpp>
#include <optional>

#include "isobrick/viewer/placed_camera.h"
#include "isobrick/viewer/render/depth_readback.h"
#include "isobrick/viewer/render/gl_handle.h"
#include "isobrick/viewer/render/gl_targets.h"

namespace isobrick {

// DepthReadback's functions have its meaning here.
class GlDepthReads {
 public:
  // Of the frame that was drawn into `targets`, with this projection.
  std::uint64_t ask(const GlTargets& targets, const glm::dvec2& pixel,
                    const DepthProjection& projection);
  std::optional<DistanceAnswer> take();

 private:
  struct Read {
    std::uint64_t question = 0;
    DepthProjection projection;
    GlBuffer depth;  // none: the pixel is outside
    GlFence fence;
  };
  std::deque<Read> reads_;
  std::uint64_t last_ = 0;
};

}  // namespace isobrick
