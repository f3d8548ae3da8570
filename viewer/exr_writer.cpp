// The only file of the viewer that knows OpenEXR.
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfRgbaFile.h>
#include <OpenEXR/ImfStandardAttributes.h>

#include <algorithm>
#include <cassert>
#include <cstring>
#include <exception>
#include <string>
#include <utility>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/image_writer.h"

namespace isobrick {
namespace {

// OpenEXR seeks back to fill in its table of line offsets, so the file grows in memory.
class MemoryStream : public Imf::OStream {
 public:
  MemoryStream() : Imf::OStream("picture in memory") {}

  void write(const char data[], int count) override {
    const std::size_t end = position_ + static_cast<std::size_t>(count);
    if (end > bytes_.size()) bytes_.resize(end);
    std::memcpy(bytes_.data() + position_, data, static_cast<std::size_t>(count));
    position_ = end;
  }
  std::uint64_t tellp() override { return position_; }
  void seekp(std::uint64_t position) override { position_ = position; }

  std::vector<char> take() { return std::move(bytes_); }

 private:
  std::vector<char> bytes_;
  std::size_t position_ = 0;
};

half toHalf(float value) {
  constexpr float kGreatestHalf = 65504.0f;  // HALF_MAX is a double in Imath 3
  return half(std::clamp(value, -kGreatestHalf, kGreatestHalf));
}

}  // namespace

std::vector<char> encodeExr(const Image& image) {
  assert(image.width > 0 && image.height > 0);
  try {
    std::vector<Imf::Rgba> pixels(image.rgb.size() / 3);
    for (std::size_t i = 0; i < pixels.size(); ++i) {
      pixels[i] = Imf::Rgba(toHalf(image.rgb[3 * i]), toHalf(image.rgb[3 * i + 1]),
                            toHalf(image.rgb[3 * i + 2]));
    }
    Imf::Header header(image.width, image.height);
    header.compression() = Imf::ZIP_COMPRESSION;
    Imf::addChromaticities(header, Imf::Chromaticities());  // the default is Rec. 709

    MemoryStream stream;
    {
      // The destructor completes the table of line offsets, so it runs before the bytes are taken.
      Imf::RgbaOutputFile file(stream, header, Imf::WRITE_RGB);
      file.setFrameBuffer(pixels.data(), 1, static_cast<std::size_t>(image.width));
      file.writePixels(image.height);
    }
    return stream.take();
  } catch (const std::exception& error) {
    throw Error("cannot encode an EXR picture of " + std::to_string(image.width) + " x " +
                std::to_string(image.height) + " pixels: " + error.what() +
                "; try a smaller picture or a .png");
  }
}

}  // namespace isobrick
