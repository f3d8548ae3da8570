// Lines, boxes and text on a picture, anti-aliased in linear light.
#pragma once

#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <memory>
#include <string>

#include "isobrick/viewer/image.h"

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

}  // namespace isobrick
