// Pictures written from top to bottom, in bands of rows: none has to fit into memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include "isobrick/viewer/image.h"

namespace isobrick {

// A picture without its pixels.
struct PictureShape {
  int width = 1;   // pixels
  int height = 1;  // pixels
  // The layers that it has beside the colours (Image).
  bool alpha = false, depth = false, normals = false;
  double pixels_per_inch = 0.0;  // of a print; 0: the file says nothing

  bool operator==(const PictureShape&) const = default;
};
PictureShape shapeOf(const Image& image);

// Takes bytes of a file for this offset. Bytes that were written may be written again.
using WriteAt = std::function<void(const void* data, std::size_t bytes, std::uint64_t offset)>;

// The bytes of a file, the same for any division into bands. Used by one thread at a time.
class BandEncoder {
 public:
  virtual ~BandEncoder() = default;
  // The next rows, with the layers of the shape. Throws Error, and what WriteAt throws.
  virtual void add(const Image& rows) = 0;
  // After the last row.
  virtual void finish() = 0;
};

// As encodePng() and encodeExr(). PNG is packed by all processors, a megabyte at a time.
std::unique_ptr<BandEncoder> makePngEncoder(const PictureShape& shape, WriteAt write);
std::unique_ptr<BandEncoder> makeExrEncoder(const PictureShape& shape, WriteAt write);
std::unique_ptr<BandEncoder> makeBandEncoder(ImageFormat format, const PictureShape& shape,
                                             WriteAt write);

// A file in memory.
class MemoryFile {
 public:
  void write(const void* data, std::size_t bytes, std::uint64_t offset);
  std::vector<char> take() { return std::move(bytes_); }

 private:
  std::vector<char> bytes_;
};

}  // namespace isobrick
