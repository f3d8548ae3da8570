#include "isobrick/viewer/stream/slice_picture.h"

#include <algorithm>
#include <cmath>

namespace isobrick {
namespace {

// A value and its neighbours at the four sides, in steps of a pixel; at a border the value itself.
struct Neighbourhood {
  float middle, left, right, above, below;
};

// How much of the pixel lines of `width` pixels, and of 2 more, along `isovalue` cover. The
// distance to the line is that of a plane through the neighbours, which is right to a part of a
// pixel near the line.
struct Coverage {
  float line = 0.0f, rim = 0.0f;
};
Coverage coverage(const Neighbourhood& at, float isovalue, float width) {
  const float reach = 0.5f * width + 1.5f;
  const float to_line = at.middle - isovalue;
  const float left = at.middle - at.left, right = at.right - at.middle;
  const float above = at.middle - at.above, below = at.below - at.middle;
  float across = std::max(std::abs(left), std::abs(right));
  float along = std::max(std::abs(above), std::abs(below));
  if (!(to_line * to_line < reach * reach * (across * across + along * along))) return {};
  // Beside a crossing these count, the greater of both sides, so that a step of a single pixel gets
  // a line as thin as any. Further away the mean of both: a valley that stays above has no line.
  const bool is_above = to_line >= 0.0f;
  const bool crosses = (at.left >= isovalue) != is_above || (at.right >= isovalue) != is_above ||
                       (at.above >= isovalue) != is_above || (at.below >= isovalue) != is_above;
  if (!crosses) {
    across = 0.5f * (left + right);
    along = 0.5f * (above + below);
  }
  const float steepness = std::sqrt(across * across + along * along);
  if (!(steepness > 0.0f)) return {};
  const float distance = std::abs(to_line) / steepness;
  return {std::clamp(reach - 1.0f - distance, 0.0f, 1.0f),
          std::clamp(reach - distance, 0.0f, 1.0f)};
}

}  // namespace

PictureBytes drawSlice(const SliceImage& values, const std::array<double, 2>& window,
                       std::span<const SliceContour> contours, double width) {
  PictureBytes picture{values.width, values.height};
  picture.rgba.resize(4 * values.values.size());
  constexpr float kNothing = 0.07f;
  const float black = static_cast<float>(values.transform.stored(window[0]));
  const float span =
      std::max(static_cast<float>((window[1] - window[0]) / values.transform.scale), 1e-30f);
  const auto at = [&](int x, int y) {
    return values.values[static_cast<std::size_t>(y) * static_cast<std::size_t>(values.width) +
                         static_cast<std::size_t>(x)];
  };
  for (int y = 0; y < values.height; ++y) {
    for (int x = 0; x < values.width; ++x) {
      const float middle = at(x, y);
      const bool is_value = !std::isnan(middle);
      glm::vec3 color(is_value ? std::clamp((middle - black) / span, 0.0f, 1.0f) : kNothing);
      if (is_value && !contours.empty()) {
        const auto beside = [&](int dx, int dy) {
          const int nx = std::clamp(x + dx, 0, values.width - 1);
          const int ny = std::clamp(y + dy, 0, values.height - 1);
          const float value = at(nx, ny);
          return std::isnan(value) ? middle : value;
        };
        const Neighbourhood around{middle, beside(-1, 0), beside(1, 0), beside(0, -1),
                                   beside(0, 1)};
        for (const SliceContour& contour : contours) {
          // A dark edge, so that a line of any colour is seen on any grey.
          constexpr float kEdge = 0.6f;
          const Coverage cover =
              coverage(around, static_cast<float>(values.transform.stored(contour.isovalue)),
                       static_cast<float>(width));
          color *= 1.0f - kEdge * cover.rim;
          color += cover.line * (contour.color - color);
        }
      }
      std::uint8_t* const pixel = picture.rgba.data() + picture.offsetOf(x, y);
      for (glm::length_t c = 0; c < 3; ++c)
        pixel[c] = static_cast<std::uint8_t>(255.0f * std::clamp(color[c], 0.0f, 1.0f) + 0.5f);
      pixel[3] = 255;
    }
  }
  return picture;
}

}  // namespace isobrick
