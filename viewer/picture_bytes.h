// A picture for a screen: 8 bits a channel.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace isobrick {

// Red, green, blue and alpha of each pixel, sRGB and not premultiplied, rows from top to bottom.
struct PictureBytes {
  int width = 0;   // pixels
  int height = 0;  // pixels
  std::vector<std::uint8_t> rgba = {};

  std::size_t offsetOf(int x, int y) const {
    return 4 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                static_cast<std::size_t>(x));
  }
};

}  // namespace isobrick
