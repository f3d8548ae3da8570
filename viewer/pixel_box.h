// A rectangle of the pixels of a picture.
#pragma once

namespace isobrick {

struct PixelBox {
  int left = 0, top = 0;      // from the upper left corner of the picture
  int width = 0, height = 0;  // pixels

  int right() const { return left + width; }
  int bottom() const { return top + height; }
  bool operator==(const PixelBox&) const = default;
};

}  // namespace isobrick
