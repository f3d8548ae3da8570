// The memory that frames are drawn into, and reading it back.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <glm/vec2.hpp>
#include <optional>
#include <vector>

#include "isobrick/viewer/image.h"
#include "isobrick/viewer/placed_camera.h"
#include "isobrick/viewer/render/gl_device.h"
#include "isobrick/viewer/render/gl_handle.h"
#include "isobrick/viewer/render/scene_renderer.h"

namespace isobrick {

GlTexture makeTexture(GLenum format, int width, int height);

// Samples of colour (half floats, linear) and depth, and one of each for a pixel, which the samples
// are resolved into.
class GlTargets {
 public:
  explicit GlTargets(GlDevice& device);

  // Throws NoGraphicsMemory, and has no size then.
  void resize(int width, int height);
  int width() const { return width_; }
  int height() const { return height_; }
  int greatestSize() const { return device_.limits().pictureSize(); }
  int samples() const { return samples_; }

  GLuint sampledFrame() const { return *sampled_frame_; }
  GLuint resolvedColor() const { return *resolved_color_; }
  GLuint resolvedDepth() const { return *resolved_depth_; }
  // `what`: GL_COLOR_BUFFER_BIT or GL_DEPTH_BUFFER_BIT. Depth is that of one sample of a pixel.
  void resolve(GLbitfield what) const;

  // Multiplies the colours of what is not background with those that `draw` draws at depth 0.
  void multiply(const std::function<void()>& draw) const;
  // Pixels count from the top left.
  bool holds(const glm::dvec2& pixel) const;
  // The depth of one that it holds into a buffer, as a float; does not wait.
  void copyDepth(const glm::dvec2& pixel, GLuint buffer) const;

  // Reading back, which waits: SceneReadback::picture(), and the distances along the camera's
  // forward axis, infinity for background; rows from top to bottom.
  PixelBox all() const { return {0, 0, width_, height_}; }
  Image picture(const PixelBox& part, bool with_alpha) const;
  std::vector<float> distances(const PixelBox& part, const DepthProjection& depth) const;

 private:
  void readRows(const PixelBox& part, GLenum what, std::size_t values_a_pixel,
                std::vector<float>& values) const;

  GlDevice& device_;
  int samples_ = 1;
  int width_ = 0, height_ = 0;
  GlRenderbuffer sampled_color_, sampled_depth_;
  GlTexture resolved_color_, resolved_depth_;
  GlFramebuffer sampled_frame_, resolved_frame_;
};

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
