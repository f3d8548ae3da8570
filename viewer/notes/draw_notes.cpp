#include "isobrick/viewer/notes/draw_notes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/common.hpp>
#include <utility>

#include "isobrick/viewer/notes/picture_canvas.h"
#include "isobrick/viewer/state/measurement.h"
#include "isobrick/viewer/state/scene_handles.h"

namespace isobrick {
namespace {

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
  // Those that were used.
  NoteInks takeInks() { return std::move(used_); }
  PictureCanvas& canvas() { return canvas_; }

  void text(const glm::dvec2& left, const std::string& text) {
    const glm::vec3 ink = inkAt(left, {left.x + canvas_.widthOf(text), left.y - unit_});
    canvas_.text(left, text, ink, ink == kWhite ? kBlack : kWhite);
  }
  // The colour of a mark between two corners.
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
  const auto mark = [&](const glm::dvec2& a, const glm::dvec2& b) {
    notes.canvas().line(a, b, 0.2 * m, ink == kWhite ? kBlack : kWhite);
    notes.canvas().line(a, b, 0.12 * m, ink);
  };
  mark(begin, end);
  for (const glm::dvec2& tick : {begin, end})
    mark({tick.x, tick.y - 0.25 * m}, {tick.x, tick.y + 0.25 * m});
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
  const glm::dvec2 size(notes.width(), notes.height());
  const PixelPath path = pathOf(camera, size, mark.points);
  for (const auto& [width, ink] : {std::pair{0.24 * m, kBlack}, std::pair{0.12 * m, color}}) {
    for (const auto& [from, to] : path.lines) notes.canvas().line(from, to, width, ink);
    for (const glm::dvec2& pixel : path.points)
      notes.canvas().line(pixel, pixel, 0.25 * m + width, ink);
  }
  if (!path.points.empty())
    notes.text(path.points.back() + glm::dvec2(0.5 * m, -0.4 * m), mark.text);
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

ScaleBar scaleBarOf(double per_pixel, double most_pixels) {
  const double most = per_pixel * most_pixels;
  if (!(most > 0.0) || !std::isfinite(most)) return {};
  const double power = std::pow(10.0, std::floor(std::log10(most)));
  double length = power;
  for (const double step : {2.0, 5.0})
    if (step * power <= most) length = step * power;
  return {length, length / per_pixel};
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
