// A picture for a screen: 8 bits a channel.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
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

// The picture of a PNG file with at most `most_side` pixels to each side. Throws Error, which names
// the file, for a larger one and for all that is no PNG.
PictureBytes readPng(const std::string& path, int most_side);

}  // namespace isobrick
