#include "isobrick/viewer/window/gl_target.h"

#include <epoxy/gl.h>

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <thread>
#include <utility>
#include <vector>

namespace isobrick {

void GlTarget::present(int left, int bottom) { renderer_->present(framebuffer(), left, bottom); }

void GlTarget::presentNothing(int width, int height) {
  renderer_->presentNothing(framebuffer(), width, height);
}

Image GlTarget::screen(int width, int height) {
  const std::size_t row = 3 * static_cast<std::size_t>(width);
  std::vector<std::uint8_t> rgb(row * static_cast<std::size_t>(height));
  glBindFramebuffer(GL_READ_FRAMEBUFFER, framebuffer());
  glPixelStorei(GL_PACK_ALIGNMENT, 1);
  glReadPixels(0, 0, width, height, GL_RGB, GL_UNSIGNED_BYTE, rgb.data());
  for (int y = 0; y < height / 2; ++y) {
    const auto top = rgb.begin() + static_cast<std::ptrdiff_t>(row) * y;
    const auto bottom = rgb.begin() + static_cast<std::ptrdiff_t>(row) * (height - 1 - y);
    std::swap_ranges(top, top + static_cast<std::ptrdiff_t>(row), bottom);
  }
  return imageFromSrgb8(width, height, rgb);
}

EglTarget::EglTarget(int width, int height, double scale)
    : scale_(scale), width_(width), height_(height) {
  try {
    renew();
  } catch (...) {
    renderer_.reset();  // before its context
    throw;
  }
}

void EglTarget::renew() {
  color_ = {};
  frame_ = {};
  renderer_.reset();
  current_.reset();
  context_ = std::make_unique<EglContext>();
  current_.emplace(*context_);
  renderer_ = std::make_unique<GlSceneRenderer>();
  resize(width_, height_);
}

EglTarget::~EglTarget() { renderer_.reset(); }

// No event comes while it waits.
std::vector<InputEvent> EglTarget::takeEvents(double wait_seconds) {
  if (events_.empty() && wait_seconds > 0.0)
    std::this_thread::sleep_for(std::chrono::duration<double>(wait_seconds));
  return std::exchange(events_, {});
}

// No frame is visible, but measurements need them drawn.
void EglTarget::show() { glFinish(); }

void EglTarget::resize(int width, int height) {
  width_ = width;
  height_ = height;
  if (width > 0 && height > 0) {
    frame_ = GlFramebuffer::make();
    color_ = GlTexture::make(GLenum{GL_TEXTURE_2D});
    glTextureStorage2D(*color_, 1, GL_RGBA8, width, height);
    glNamedFramebufferTexture(*frame_, GL_COLOR_ATTACHMENT0, *color_, 0);
  }
  events_.push_back(InputEvent::resized(width, height));
}

}  // namespace isobrick
