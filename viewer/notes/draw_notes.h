// Writes notes into a picture: lines, boxes and text, anti-aliased in linear light.
#pragma once

#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <memory>
#include <string>
#include <vector>

#include "isobrick/viewer/image.h"
#include "isobrick/viewer/picture_notes.h"
#include "isobrick/viewer/placed_camera.h"

namespace isobrick {

extern const unsigned char kInterfaceFont[];
extern const int kInterfaceFontBytes;

// The pixels [first, end) of a picture's width or height that [lower, upper] touches; none if a
// bound is not a number.
struct PixelRange {
  int first = 0;
  int end = 0;
};
PixelRange pixelsBetween(double lower, double upper, int size);

// Rows of a picture of `height` rows: `image` has those from `first` on.
struct PictureRows {
  Image& image;
  int first = 0;
  int height = 0;

  int end() const { return first + image.height; }
};

// Colours are sRGB values 0..1; places are pixels from the upper left corner of the picture. Marks
// outside of it, and of the rows, are cut off, however far they reach. Layers beside the colours
// and alpha stay as they are.
class PictureCanvas {
 public:
  // The image outlives it. Throws Error if isobrick was built without a font.
  PictureCanvas(const PictureRows& rows, double text_pixels);
  PictureCanvas(Image& image, double text_pixels)
      : PictureCanvas(PictureRows{image, 0, image.height}, text_pixels) {}
  ~PictureCanvas();
  PictureCanvas(const PictureCanvas&) = delete;
  PictureCanvas& operator=(const PictureCanvas&) = delete;

  void line(const glm::dvec2& from, const glm::dvec2& to, double width, const glm::vec3& color);
  void box(const glm::dvec2& upper_left, const glm::dvec2& lower_right, const glm::vec3& color);
  // UTF-8, on one line that begins at `left` of a base line, with a margin of `halo` around the
  // letters, which keeps them legible on any ground.
  void text(const glm::dvec2& left, const std::string& text, const glm::vec3& color,
            const glm::vec3& halo);
  double widthOf(const std::string& text) const;
  double textPixels() const { return text_pixels_; }

 private:
  struct Font;
  void blend(int x, int y, double coverage, const glm::vec3& linear);
  PixelRange rowsBetween(double lower, double upper, int margin = 0) const;

  const PictureRows rows_;
  const double text_pixels_;
  std::unique_ptr<Font> font_;
};

// A round length, 1, 2 or 5 times a power of ten, and its size in a picture.
struct ScaleBar {
  double length = 0.0;  // world units
  double pixels = 0.0;
};
// At most `most_pixels` long, if a pixel is `per_pixel` world units; 0 without a scale.
ScaleBar scaleBarOf(double per_pixel, double most_pixels);
// A line of a note, pixels, or a dot if it ends where it begins.
struct NoteStroke {
  glm::dvec2 from{0.0}, to{0.0};

  bool isDot() const { return from == to; }
};
// The bar that ends at `end`, with its ticks, `tick` pixels up and down.
std::vector<NoteStroke> strokesOf(const ScaleBar& bar, const glm::dvec2& end, double tick);
// The lines and then the points of a mark, as a picture of this size shows them.
std::vector<NoteStroke> strokesOf(const std::vector<glm::dvec3>& points, const PlacedCamera& camera,
                                  const glm::dvec2& size);

// "50 mm", "20 µm"; without a unit if the world's is not known.
std::string lengthText(double length, LengthUnit unit);

// For each text and mark in the order in which they are drawn, if it is white: on a dark ground.
using NoteInks = std::vector<bool>;

// `camera` drew the picture; `target_distance` is from its eye to what the scale bar measures, in
// world units. Throws Error if there is something to draw, and isobrick was built without a font.
NoteInks drawNotes(const PictureNotes& notes, const PlacedCamera& camera, double target_distance,
                   Image& image);
// The same into some rows of a picture, whose other rows may not be there, with the inks of the
// same picture, whatever its size.
void drawNotes(const PictureNotes& notes, const PlacedCamera& camera, double target_distance,
               const NoteInks& inks, const PictureRows& rows);

}  // namespace isobrick
