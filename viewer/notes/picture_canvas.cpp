#include "isobrick/viewer/notes/picture_canvas.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <optional>
#include <vector>

#include "isobrick/storage/error.h"

#define STB_TRUETYPE_IMPLEMENTATION
#define STBTT_STATIC
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-function"
#include <stb_truetype.h>
#pragma GCC diagnostic pop

namespace isobrick {
namespace {

glm::vec3 linearOf(const glm::vec3& srgb) {
  return {linearFromSrgb(srgb.r), linearFromSrgb(srgb.g), linearFromSrgb(srgb.b)};
}

// Of UTF-8; a byte that is none stands for itself as '?'.
std::vector<int> codePointsOf(const std::string& text) {
  std::vector<int> points;
  for (std::size_t at = 0; at < text.size();) {
    const auto first = static_cast<unsigned char>(text[at]);
    const std::size_t count = first < 0x80   ? 1
                              : first < 0xc0 ? 0
                              : first < 0xe0 ? 2
                              : first < 0xf0 ? 3
                                             : 4;
    if (count == 0 || at + count > text.size()) {
      points.push_back('?');
      ++at;
      continue;
    }
    int point = count == 1 ? first : first & (0xff >> (count + 1));
    for (std::size_t i = 1; i < count; ++i)
      point = (point << 6) | (static_cast<unsigned char>(text[at + i]) & 0x3f);
    points.push_back(point);
    at += count;
  }
  return points;
}

// The part of a line within `margin` of the picture. A line to a far place would lose its digits.
std::optional<std::array<glm::dvec2, 2>> lineInPicture(const glm::dvec2& from, const glm::dvec2& to,
                                                       const glm::dvec2& picture, double margin) {
  const glm::dvec2 along = to - from;
  double first = 0.0, last = 1.0;
  for (int axis = 0; axis < 2; ++axis) {
    const double least = -margin - from[axis], most = picture[axis] + margin - from[axis];
    if (along[axis] == 0.0) {
      if (least > 0.0 || most < 0.0) return std::nullopt;
      continue;
    }
    const double a = least / along[axis], b = most / along[axis];
    first = std::max(first, std::min(a, b));
    last = std::min(last, std::max(a, b));
  }
  if (!(first <= last)) return std::nullopt;
  return {{from + first * along, from + last * along}};
}

// How much of each pixel of a box of the picture is covered, 0 .. 1.
struct Mask {
  int left, top, width, height;
  std::vector<float> cover;
  Mask(const PixelRange& x, const PixelRange& y)
      : left(x.first),
        top(y.first),
        width(x.end - x.first),
        height(y.end - y.first),
        cover(static_cast<std::size_t>(width) * static_cast<std::size_t>(height)) {}
  float& at(int x, int y) {
    return cover[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                 static_cast<std::size_t>(x)];
  }
};

// Every pixel as much as the most covered one within `radius`. A pixel whose four neighbours are
// covered as much adds nothing to what they give.
Mask grown(Mask& mask, int radius) {
  const auto isInside = [&](int x, int y) {
    if (x == 0 || y == 0 || x + 1 == mask.width || y + 1 == mask.height) return false;
    const float cover = mask.at(x, y);
    return mask.at(x - 1, y) >= cover && mask.at(x + 1, y) >= cover && mask.at(x, y - 1) >= cover &&
           mask.at(x, y + 1) >= cover;
  };
  Mask wide = mask;
  for (int y = 0; y < mask.height; ++y)
    for (int x = 0; x < mask.width; ++x) {
      const float cover = mask.at(x, y);
      if (cover == 0.0f || isInside(x, y)) continue;
      for (int v = std::max(0, y - radius); v <= std::min(mask.height - 1, y + radius); ++v)
        for (int u = std::max(0, x - radius); u <= std::min(mask.width - 1, x + radius); ++u)
          if ((u - x) * (u - x) + (v - y) * (v - y) <= radius * radius)
            wide.at(u, v) = std::max(wide.at(u, v), cover);
    }
  return wide;
}

}  // namespace

PixelRange pixelsBetween(double lower, double upper, int size) {
  if (!(lower <= upper) || upper < 0.0 || lower >= size) return {};
  return {static_cast<int>(std::max(0.0, std::floor(lower))),
          static_cast<int>(std::min<double>(size, std::floor(upper) + 1.0))};
}

struct PictureCanvas::Font {
  stbtt_fontinfo info;
  float scale = 1.0f;

  // The width up to the next letter, with the kerning of the pair.
  double advance(int point, int next) const {
    int width = 0, bearing = 0;
    stbtt_GetCodepointHMetrics(&info, point, &width, &bearing);
    const int kern = next != 0 ? stbtt_GetCodepointKernAdvance(&info, point, next) : 0;
    return static_cast<double>(scale) * (width + kern);
  }
};

PictureCanvas::PictureCanvas(const PictureRows& rows, double text_pixels)
    : rows_(rows), text_pixels_(std::max(6.0, text_pixels)), font_(std::make_unique<Font>()) {
  if (kInterfaceFontBytes == 0 || stbtt_InitFont(&font_->info, kInterfaceFont, 0) == 0)
    throw Error(
        "cannot write into pictures: isobrick was built without a font; build it with "
        "-D ISOBRICK_FONT=FILE.ttf, or leave scale bar, axes and legend out");
  font_->scale = stbtt_ScaleForPixelHeight(&font_->info, static_cast<float>(text_pixels_));
}

PictureCanvas::~PictureCanvas() = default;

void PictureCanvas::blend(int x, int y, double coverage, const glm::vec3& linear) {
  Image& image = rows_.image;
  if (x < 0 || y < rows_.first || x >= image.width || y >= rows_.end() || !(coverage > 0.0)) return;
  const auto cover = static_cast<float>(std::min(coverage, 1.0));
  const std::size_t at = image.offsetOf(x, y - rows_.first);
  float* const rgb = image.rgb.data() + at;
  for (int c = 0; c < 3; ++c) rgb[c] += cover * (linear[c] - rgb[c]);
  if (image.alpha.empty()) return;
  float& alpha = image.alpha[at / 3];
  alpha += cover * (1.0f - alpha);
}

// The rows of the picture that [lower, upper] touches, as far as they are at most `margin` from
// those that are drawn.
PixelRange PictureCanvas::rowsBetween(double lower, double upper, int margin) const {
  PixelRange rows = pixelsBetween(lower, upper, rows_.height);
  rows.first = std::max(rows.first, rows_.first - margin);
  rows.end = std::min(rows.end, rows_.end() + margin);
  return rows.first < rows.end ? rows : PixelRange{};
}

void PictureCanvas::line(const glm::dvec2& from, const glm::dvec2& to, double width,
                         const glm::vec3& color) {
  const auto seen = lineInPicture(from, to, {rows_.image.width, rows_.height}, 2.0 * width + 1.0);
  if (!seen) return;
  const glm::vec3 linear = linearOf(color);
  const auto& [begin, end] = *seen;
  const glm::dvec2 lower = glm::min(begin, end) - width, upper = glm::max(begin, end) + width;
  const glm::dvec2 along = end - begin;
  const double squared = std::max(glm::dot(along, along), 1e-12);
  const PixelRange rows = rowsBetween(lower.y, upper.y);
  for (int y = rows.first; y < rows.end; ++y) {
    // The part of the line that is near this row.
    double first = 0.0, last = 1.0;
    if (along.y != 0.0) {
      const double a = (y - width - 1.0 - begin.y) / along.y;
      const double b = (y + width + 2.0 - begin.y) / along.y;
      first = std::max(first, std::min(a, b));
      last = std::min(last, std::max(a, b));
    }
    if (first > last) continue;
    const auto [left, right] = std::minmax({begin.x + first * along.x, begin.x + last * along.x});
    const PixelRange columns =
        pixelsBetween(left - width - 1.0, right + width + 1.0, rows_.image.width);
    for (int x = columns.first; x < columns.end; ++x) {
      const glm::dvec2 arm = glm::dvec2(x + 0.5, y + 0.5) - begin;
      const double share = glm::clamp(glm::dot(arm, along) / squared, 0.0, 1.0);
      blend(x, y, 0.5 + 0.5 * width - glm::length(arm - share * along), linear);
    }
  }
}

void PictureCanvas::box(const glm::dvec2& upper_left, const glm::dvec2& lower_right,
                        const glm::vec3& color) {
  const glm::vec3 linear = linearOf(color);
  const auto covered = [](int pixel, double from, double to) {
    return std::clamp(std::min(to, pixel + 1.0) - std::max(from, static_cast<double>(pixel)), 0.0,
                      1.0);
  };
  const PixelRange columns = pixelsBetween(upper_left.x, lower_right.x, rows_.image.width);
  const PixelRange rows = rowsBetween(upper_left.y, lower_right.y);
  for (int y = rows.first; y < rows.end; ++y)
    for (int x = columns.first; x < columns.end; ++x)
      blend(x, y, covered(x, upper_left.x, lower_right.x) * covered(y, upper_left.y, lower_right.y),
            linear);
}

double PictureCanvas::widthOf(const std::string& text) const {
  const std::vector<int> points = codePointsOf(text);
  double width = 0.0;
  for (std::size_t i = 0; i < points.size(); ++i)
    width += font_->advance(points[i], i + 1 < points.size() ? points[i + 1] : 0);
  return width;
}

void PictureCanvas::text(const glm::dvec2& left, const std::string& text, const glm::vec3& color,
                         const glm::vec3& halo) {
  const int radius = std::max(1, static_cast<int>(std::lround(text_pixels_ / 10.0)));
  const double top = left.y - 0.8 * text_pixels_;
  const PixelRange columns =
      pixelsBetween(left.x - radius, left.x + widthOf(text) + radius + 2.0, rows_.image.width);
  const PixelRange rows = rowsBetween(top - radius, top + text_pixels_ + radius, radius);
  if (columns.first == columns.end || rows.first == rows.end) return;
  Mask mask(columns, rows);
  const int base = static_cast<int>(std::lround(left.y)) - mask.top;
  const std::vector<int> points = codePointsOf(text);
  double pen = left.x - mask.left;
  for (std::size_t i = 0; i < points.size() && pen < mask.width + radius; ++i) {
    const float shift = static_cast<float>(pen - std::floor(pen));
    int x0 = 0, y0 = 0, x1 = 0, y1 = 0;
    stbtt_GetCodepointBitmapBoxSubpixel(&font_->info, points[i], font_->scale, font_->scale, shift,
                                        0.0f, &x0, &y0, &x1, &y1);
    const int w = x1 - x0, h = y1 - y0;
    if (w > 0 && h > 0) {
      std::vector<unsigned char> letter(static_cast<std::size_t>(w) * static_cast<std::size_t>(h));
      stbtt_MakeCodepointBitmapSubpixel(&font_->info, letter.data(), w, h, w, font_->scale,
                                        font_->scale, shift, 0.0f, points[i]);
      for (int y = 0; y < h; ++y)
        for (int x = 0; x < w; ++x) {
          const int u = static_cast<int>(std::floor(pen)) + x0 + x, v = base + y0 + y;
          if (u < 0 || v < 0 || u >= mask.width || v >= mask.height) continue;
          const auto value = letter[static_cast<std::size_t>(y) * static_cast<std::size_t>(w) +
                                    static_cast<std::size_t>(x)];
          mask.at(u, v) = std::max(mask.at(u, v), static_cast<float>(value) / 255.0f);
        }
    }
    pen += font_->advance(points[i], i + 1 < points.size() ? points[i + 1] : 0);
  }
  Mask around = grown(mask, radius);
  constexpr double kHalo = 0.55;
  for (int y = 0; y < mask.height; ++y)
    for (int x = 0; x < mask.width; ++x) {
      blend(mask.left + x, mask.top + y, kHalo * static_cast<double>(around.at(x, y)),
            linearOf(halo));
      blend(mask.left + x, mask.top + y, static_cast<double>(mask.at(x, y)), linearOf(color));
    }
}

}  // namespace isobrick
