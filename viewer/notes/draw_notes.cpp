#include "isobrick/viewer/notes/draw_notes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/state/measurement.h"
#include "isobrick/viewer/state/scene_handles.h"

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

constexpr double kTextOfHeight = 1.0 / 36.0;  // of the picture
constexpr double kMostTextPixels = 1024.0;    // the halo around a letter takes time
constexpr glm::vec3 kWhite{1.0f}, kBlack{0.05f};

// Draws text and marks in white, or in black on a light ground: that of the picture so far, or by
// inks that are given.
class Notes {
 public:
  Notes(const PictureRows& rows, const NoteInks* given)
      : rows_(rows),
        canvas_(rows,
                std::min(kTextOfHeight * std::min(rows.height, rows.image.width), kMostTextPixels)),
        unit_(canvas_.textPixels()),
        given_(given) {}

  double unit() const { return unit_; }
  // Of the whole picture, pixels.
  int width() const { return rows_.image.width; }
  int height() const { return rows_.height; }
  NoteInks takeInks() { return std::move(used_); }
  PictureCanvas& canvas() { return canvas_; }

  void text(const glm::dvec2& left, const std::string& text) {
    const glm::vec3 ink = inkAt(left, {left.x + canvas_.widthOf(text), left.y - unit_});
    canvas_.text(left, text, ink, ink == kWhite ? kBlack : kWhite);
  }
  glm::vec3 inkAt(const glm::dvec2& a, const glm::dvec2& b) {
    used_.push_back(given_ != nullptr ? used_.size() >= given_->size() || (*given_)[used_.size()]
                                      : isDarkAt(a, b));
    return used_.back() ? kWhite : kBlack;
  }

 private:
  bool isDarkAt(const glm::dvec2& a, const glm::dvec2& b) const {
    const Image& image = rows_.image;
    double light = 0.0, count = 0.0;
    const glm::dvec2 lower = glm::min(a, b), upper = glm::max(a, b);
    const PixelRange columns = pixelsBetween(lower.x, upper.x, image.width);
    const PixelRange rows = pixelsBetween(lower.y, upper.y, image.height);
    for (int y = rows.first; y < rows.end; ++y)
      for (int x = columns.first; x < columns.end; ++x) {
        const float* const rgb = image.rgb.data() + image.offsetOf(x, y);
        light += 0.2126 * static_cast<double>(rgb[0]) + 0.7152 * static_cast<double>(rgb[1]) +
                 0.0722 * static_cast<double>(rgb[2]);
        count += 1.0;
      }
    // Equal contrast to black and to white: (L + 0.05)^2 = 0.05 * 1.05 (WCAG 2.2).
    return light <= 0.18 * count;
  }

  const PictureRows rows_;
  PictureCanvas canvas_;
  double unit_;
  const NoteInks* const given_;
  NoteInks used_;
};

void scaleBar(Notes& notes, double per_pixel, LengthUnit unit) {
  const double m = notes.unit();
  const ScaleBar bar = scaleBarOf(per_pixel, 0.25 * notes.width());
  if (bar.length == 0.0) return;
  const glm::dvec2 end(notes.width() - m, notes.height() - m), begin(end.x - bar.pixels, end.y);
  const std::string label = lengthText(bar.length, unit);
  const glm::vec3 ink = notes.inkAt({begin.x, begin.y - m}, end);
  for (const NoteStroke& stroke : strokesOf(bar, end, 0.25 * m)) {
    notes.canvas().line(stroke.from, stroke.to, 0.2 * m, ink == kWhite ? kBlack : kWhite);
    notes.canvas().line(stroke.from, stroke.to, 0.12 * m, ink);
  }
  const double width = notes.canvas().widthOf(label);
  notes.text({0.5 * (begin.x + end.x - width), begin.y - 0.5 * m}, label);
}

// The axes that point away from the eye first.
void axes(Notes& notes, const PlacedCamera& camera) {
  const double m = notes.unit(), length = 2.6 * m;
  const glm::dvec2 foot(3.6 * m, notes.height() - 3.6 * m);
  struct Axis {
    glm::dvec3 seen;  // right, up, away
    glm::vec3 color;
    const char* name;
  };
  std::array<Axis, 3> all{{{{}, {0.90f, 0.35f, 0.31f}, "x"},
                           {{}, {0.43f, 0.78f, 0.35f}, "y"},
                           {{}, {0.38f, 0.58f, 0.96f}, "z"}}};
  for (int axis = 0; axis < 3; ++axis)
    all[static_cast<std::size_t>(axis)].seen = {camera.right[axis], camera.up[axis],
                                                camera.forward[axis]};
  std::sort(all.begin(), all.end(),
            [](const Axis& a, const Axis& b) { return a.seen.z > b.seen.z; });
  for (const Axis& axis : all) {
    const glm::dvec2 arm(axis.seen.x, -axis.seen.y);
    const glm::dvec2 tip = foot + length * arm;
    notes.canvas().line(foot, tip, 0.16 * m, axis.color);
    const double width = notes.canvas().widthOf(axis.name);
    notes.text(tip + 0.55 * m * arm + glm::dvec2(-0.5 * width, 0.3 * m), axis.name);
  }
}

void legendOf(Notes& notes, const PictureLegend& legend) {
  const double m = notes.unit();
  double top = m;
  for (const PictureLegend::Patch& patch : legend.patches) {
    notes.canvas().box({m, top}, {2.0 * m, top + m}, patch.color);
    notes.text({2.5 * m, top + 0.82 * m}, patch.text);
    top += 1.4 * m;
  }
  if (!legend.rest.empty()) notes.text({m, top + 0.82 * m}, legend.rest);
  if (!legend.ramp) return;
  if (!legend.ramp_title.empty()) {
    notes.text({m, top + 0.82 * m}, legend.ramp_title);
    top += 1.3 * m;
  }
  // Boxes of whole pixels, beside each other without the ground between them.
  const double left = std::round(m), width = std::round(9.0 * m);
  const int steps = static_cast<int>(width);
  for (int i = 0; i < steps; ++i)
    notes.canvas().box({left + i, top}, {left + i + 1.0, top + 0.8 * m},
                       valueColor(legend.ramp_colors, (i + 0.5) / static_cast<double>(steps)));
  const std::string least = shortNumber((*legend.ramp)[0]), most = shortNumber((*legend.ramp)[1]);
  notes.text({left, top + 1.9 * m}, least);
  notes.text({left + width - notes.canvas().widthOf(most), top + 1.9 * m}, most);
}

void mark(Notes& notes, const PlacedCamera& camera, const PictureMark& mark) {
  const double m = notes.unit();
  const glm::vec3 color{1.0f, 0.84f, 0.40f};
  const auto strokes = strokesOf(mark.points, camera, {notes.width(), notes.height()});
  for (const auto& [width, ink] : {std::pair{0.24 * m, kBlack}, std::pair{0.12 * m, color}})
    for (const NoteStroke& stroke : strokes)
      notes.canvas().line(stroke.from, stroke.to, width + (stroke.isDot() ? 0.25 * m : 0.0), ink);
  if (!strokes.empty()) notes.text(strokes.back().to + glm::dvec2(0.5 * m, -0.4 * m), mark.text);
}

void drawAll(const PictureNotes& notes, const PlacedCamera& camera, double target_distance,
             Notes& drawn) {
  const double height = 2.0 * camera.half_height * (camera.orthographic ? 1.0 : target_distance);
  for (const PictureMark& of_scene : notes.marks) mark(drawn, camera, of_scene);
  if (notes.scale_bar) scaleBar(drawn, height / drawn.height(), notes.unit);
  if (notes.axes) axes(drawn, camera);
  if (notes.legend) legendOf(drawn, notes.meaning);
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

ScaleBar scaleBarOf(double per_pixel, double most_pixels) {
  const double most = per_pixel * most_pixels;
  if (!(most > 0.0) || !std::isfinite(most)) return {};
  const double power = std::pow(10.0, std::floor(std::log10(most)));
  double length = power;
  for (const double step : {2.0, 5.0})
    if (step * power <= most) length = step * power;
  return {length, length / per_pixel};
}

std::vector<NoteStroke> strokesOf(const ScaleBar& bar, const glm::dvec2& end, double tick) {
  const glm::dvec2 begin(end.x - bar.pixels, end.y), up(0.0, tick);
  return {{begin, end}, {begin - up, begin + up}, {end - up, end + up}};
}

std::vector<NoteStroke> strokesOf(const std::vector<glm::dvec3>& points, const PlacedCamera& camera,
                                  const glm::dvec2& size) {
  const PixelPath path = pathOf(camera, size, points);
  std::vector<NoteStroke> strokes;
  for (const auto& [from, to] : path.lines) strokes.push_back({from, to});
  for (const glm::dvec2& pixel : path.points) strokes.push_back({pixel, pixel});
  return strokes;
}

std::string lengthText(double length, LengthUnit unit) {
  if (unit != LengthUnit::kMillimetre) return shortNumber(length);
  if (length < 0.1) return shortNumber(1e3 * length) + " \u00b5m";
  if (length >= 1e4) return shortNumber(1e-3 * length) + " m";
  return shortNumber(length) + " mm";
}

NoteInks drawNotes(const PictureNotes& notes, const PlacedCamera& camera, double target_distance,
                   Image& image) {
  if (!notes.any() || image.width < 1 || image.height < 1) return {};
  Notes drawn({image, 0, image.height}, nullptr);
  drawAll(notes, camera, target_distance, drawn);
  return drawn.takeInks();
}

void drawNotes(const PictureNotes& notes, const PlacedCamera& camera, double target_distance,
               const NoteInks& inks, const PictureRows& rows) {
  if (!notes.any() || rows.image.width < 1 || rows.image.height < 1) return;
  Notes drawn(rows, &inks);
  drawAll(notes, camera, target_distance, drawn);
}

}  // namespace isobrick
