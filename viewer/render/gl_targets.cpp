#include "isobrick/viewer/render/gl_targets.h"

#include <limits>
#include <string>

#include "isobrick/viewer/stream/chunk_store.h"

namespace isobrick {

GlTexture makeTexture(GLenum format, int width, int height) {
  GlTexture texture = GlTexture::make(GLenum{GL_TEXTURE_2D});
  glTextureStorage2D(*texture, 1, format, width, height);
  return texture;
}

GlTargets::GlTargets(GlDevice& device)
    : device_(device), samples_(device.limits().pictureSamples()) {}

void GlTargets::resize(int width, int height) {
  if (width == width_ && height == height_) return;
  width_ = height_ = 0;  // stays so if this fails
  device_.forgetErrors();
  const auto allocate = [&](GlRenderbuffer& buffer, GLenum format) {
    buffer = GlRenderbuffer::make();
    glNamedRenderbufferStorageMultisample(*buffer, samples_, format, width, height);
  };
  allocate(sampled_color_, GL_RGBA16F);
  allocate(sampled_depth_, GL_DEPTH_COMPONENT32F);
  resolved_color_ = makeTexture(GL_RGBA16F, width, height);
  resolved_depth_ = makeTexture(GL_DEPTH_COMPONENT32F, width, height);

  sampled_frame_ = GlFramebuffer::make();
  glNamedFramebufferRenderbuffer(*sampled_frame_, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER,
                                 *sampled_color_);
  glNamedFramebufferRenderbuffer(*sampled_frame_, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER,
                                 *sampled_depth_);
  resolved_frame_ = GlFramebuffer::make();
  glNamedFramebufferTexture(*resolved_frame_, GL_COLOR_ATTACHMENT0, *resolved_color_, 0);
  glNamedFramebufferTexture(*resolved_frame_, GL_DEPTH_ATTACHMENT, *resolved_depth_, 0);
  const auto complete = [](const GlFramebuffer& frame) {
    return glCheckNamedFramebufferStatus(*frame, GL_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE;
  };
  const std::string no_memory = "cannot render: no memory for a picture of " +
                                std::to_string(width) + " x " + std::to_string(height) +
                                " pixels; choose a smaller width or height";
  device_.checkErrors(no_memory);
  if (complete(sampled_frame_) && complete(resolved_frame_)) {
    width_ = width;
    height_ = height;
    return;
  }
  if (device_.isLost()) throw RendererLost();
  throw NoGraphicsMemory(no_memory);
}

void GlTargets::resolve(GLbitfield what) const {
  glBlitNamedFramebuffer(*sampled_frame_, *resolved_frame_, 0, 0, width_, height_, 0, 0, width_,
                         height_, what, GL_NEAREST);
}

std::optional<double> GlTargets::distanceAt(const glm::dvec2& pixel,
                                            const DepthProjection& projection) const {
  const int x = static_cast<int>(pixel.x), y = height_ - 1 - static_cast<int>(pixel.y);
  if (pixel.x < 0.0 || pixel.y < 0.0 || x >= width_ || y < 0) return std::nullopt;
  // Samples may be resolved only if both rectangles are the same.
  glBlitNamedFramebuffer(*sampled_frame_, *resolved_frame_, x, y, x + 1, y + 1, x, y, x + 1, y + 1,
                         GL_DEPTH_BUFFER_BIT, GL_NEAREST);
  glBindFramebuffer(GL_READ_FRAMEBUFFER, *resolved_frame_);
  float depth = 0.0f;
  glReadPixels(x, y, 1, 1, GL_DEPTH_COMPONENT, GL_FLOAT, &depth);
  if (!(depth > 0.0f)) return std::nullopt;
  return projection.distanceAt(depth);
}

Image GlTargets::picture(bool with_alpha) const {
  const std::size_t row_floats = 3 * static_cast<std::size_t>(width_);
  const std::size_t pixels = static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_);
  Image image{width_, height_, std::vector<float>(3 * pixels)};
  if (with_alpha) image.alpha.resize(pixels);
  glBindFramebuffer(GL_READ_FRAMEBUFFER, *resolved_frame_);
  glPixelStorei(GL_PACK_ALIGNMENT, 1);
  // Row by row, because OpenGL counts them from the bottom.
  for (int y = 0; y < height_; ++y) {
    glReadPixels(0, height_ - 1 - y, width_, 1, GL_RGB, GL_FLOAT,
                 image.rgb.data() + static_cast<std::size_t>(y) * row_floats);
    if (with_alpha)
      glReadPixels(0, height_ - 1 - y, width_, 1, GL_ALPHA, GL_FLOAT,
                   image.alpha.data() + static_cast<std::size_t>(y) * row_floats / 3);
  }
  if (device_.isLost()) throw RendererLost();  // nothing was read
  return image;
}

std::vector<float> GlTargets::distances(const DepthProjection& depth) const {
  resolve(GL_DEPTH_BUFFER_BIT);
  glBindFramebuffer(GL_READ_FRAMEBUFFER, *resolved_frame_);
  const auto row = static_cast<std::size_t>(width_);
  std::vector<float> distances(row * static_cast<std::size_t>(height_));
  for (int y = 0; y < height_; ++y)
    glReadPixels(0, height_ - 1 - y, width_, 1, GL_DEPTH_COMPONENT, GL_FLOAT,
                 distances.data() + static_cast<std::size_t>(y) * row);
  if (device_.isLost()) throw RendererLost();
  for (float& value : distances)
    value = value > 0.0f ? static_cast<float>(depth.distanceAt(value))
                         : std::numeric_limits<float>::infinity();
  return distances;
}

}  // namespace isobrick
