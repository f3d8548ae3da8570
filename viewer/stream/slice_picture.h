// The values of a slice as a picture for a screen, with the contours of surfaces in it.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "isobrick/viewer/stream/slice_store.h"

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

// The line where the values of a slice are `isovalue`: there a surface meets the slice.
struct SliceContour {
  double isovalue = 0.0;  // data units
  glm::vec3 color{1.0f};  // sRGB, 0 .. 1

  bool operator==(const SliceContour&) const = default;
};

// Greys from `window`[0], black, to `window`[1], white (data units, sRGB values between them), and
// contours of `width` pixels over them, smooth at their edges and with a dark rim of a pixel. Where
// there is no value the picture is dark. `values`: at least one.
PictureBytes drawSlice(const SliceImage& values, const std::array<double, 2>& window,
                       std::span<const SliceContour> contours, double width);

}  // namespace isobrick
