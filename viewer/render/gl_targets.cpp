#include "isobrick/viewer/render/gl_targets.h"

#include <algorithm>
#include <limits>
#include <string>
#include <utility>

#include "isobrick/viewer/stream/chunk_store.h"

namespace isobrick {
namespace {
constexpr std::size_t kReadBytes = std::size_t{1} << 20;  // at a time
}

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

void GlTargets::multiply(const std::function<void()>& draw) const {
  glBindFramebuffer(GL_FRAMEBUFFER, *sampled_frame_);
  glEnable(GL_DEPTH_TEST);
  glDepthMask(GL_FALSE);
  glDepthFunc(GL_LESS);  // passes everything that is not background
  glEnable(GL_BLEND);
  glBlendFuncSeparate(GL_ZERO, GL_SRC_COLOR, GL_ZERO, GL_ONE);
  draw();
  glDisable(GL_BLEND);
  glDepthFunc(GL_GREATER);
  glDepthMask(GL_TRUE);
}

bool GlTargets::holds(const glm::dvec2& pixel) const {
  return pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < width_ && pixel.y < height_;
}

void GlTargets::copyDepth(const glm::dvec2& pixel, GLuint buffer) const {
  const int x = static_cast<int>(pixel.x), y = height_ - 1 - static_cast<int>(pixel.y);
  // Samples may be resolved only if both rectangles are the same.
  glBlitNamedFramebuffer(*sampled_frame_, *resolved_frame_, x, y, x + 1, y + 1, x, y, x + 1, y + 1,
                         GL_DEPTH_BUFFER_BIT, GL_NEAREST);
  glBindFramebuffer(GL_READ_FRAMEBUFFER, *resolved_frame_);
  glBindBuffer(GL_PIXEL_PACK_BUFFER, buffer);
  glReadPixels(x, y, 1, 1, GL_DEPTH_COMPONENT, GL_FLOAT, nullptr);
  glBindBuffer(GL_PIXEL_PACK_BUFFER, 0);
}

// OpenGL counts rows from the bottom, so they are turned round here. Some at a time: a card takes
// as long for one row as for many of them.
void GlTargets::readRows(const PixelBox& part, GLenum what, std::size_t values_a_pixel,
                         std::vector<float>& values) const {
  glBindFramebuffer(GL_READ_FRAMEBUFFER, *resolved_frame_);
  glPixelStorei(GL_PACK_ALIGNMENT, 1);
  const std::size_t row = values_a_pixel * static_cast<std::size_t>(part.width);
  values.resize(row * static_cast<std::size_t>(part.height));
  const int most =
      static_cast<int>(std::clamp<std::size_t>(kReadBytes / (row * sizeof(float)), 1, 1024));
  std::vector<float> rows(row * static_cast<std::size_t>(std::min(most, part.height)));
  for (int y = 0; y < part.height; y += most) {
    const int count = std::min(most, part.height - y);
    glReadPixels(part.left, height_ - (part.top + y + count), part.width, count, what, GL_FLOAT,
                 rows.data());
    for (int i = 0; i < count; ++i)
      std::copy_n(rows.data() + static_cast<std::size_t>(count - 1 - i) * row, row,
                  values.data() + static_cast<std::size_t>(y + i) * row);
  }
  if (device_.isLost()) throw RendererLost();  // nothing was read
}

Image GlTargets::picture(const PixelBox& part, bool with_alpha) const {
  Image image{part.width, part.height, {}};
  readRows(part, GL_RGB, 3, image.rgb);
  if (with_alpha) readRows(part, GL_ALPHA, 1, image.alpha);
  return image;
}

std::vector<float> GlTargets::distances(const PixelBox& part, const DepthProjection& depth) const {
  resolve(GL_DEPTH_BUFFER_BIT);
  std::vector<float> distances;
  readRows(part, GL_DEPTH_COMPONENT, 1, distances);
  for (float& value : distances)
    value = value > 0.0f ? static_cast<float>(depth.distanceAt(value))
                         : std::numeric_limits<float>::infinity();
  return distances;
}

std::uint64_t GlDepthReads::ask(const GlTargets& targets, const glm::dvec2& pixel,
                                const DepthProjection& projection) {
  Read read;
  read.question = ++last_;
  read.projection = projection;
  if (targets.holds(pixel)) {
    read.depth = GlBuffer::make();
    glNamedBufferStorage(*read.depth, sizeof(float), nullptr, GL_CLIENT_STORAGE_BIT);
    targets.copyDepth(pixel, *read.depth);
    read.fence = GlFence::make();
  }
  reads_.push_back(std::move(read));
  return last_;
}

std::optional<DistanceAnswer> GlDepthReads::take() {
  if (reads_.empty() || !reads_.front().fence.isPassed()) return std::nullopt;
  const Read read = std::move(reads_.front());
  reads_.pop_front();
  DistanceAnswer answer{read.question, std::nullopt};
  if (*read.depth == 0) return answer;
  float depth = 0.0f;
  glGetNamedBufferSubData(*read.depth, 0, sizeof(float), &depth);
  if (depth > 0.0f) answer.distance = read.projection.distanceAt(depth);
  return answer;
}

}  // namespace isobrick
