#include "isobrick/viewer/window/gl_target.h"

#include <epoxy/gl.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
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

}  // namespace isobrick
