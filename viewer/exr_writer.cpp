// The only file of the viewer that uses OpenEXR.
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfStandardAttributes.h>

#include <algorithm>
#include <cassert>
#include <cstring>
#include <deque>
#include <exception>
#include <string>
#include <utility>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/image.h"

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

Imf::Slice sliceOf(Imf::PixelType type, void* values, std::size_t bytes, int width) {
  return {type, static_cast<char*>(values), bytes, bytes * static_cast<std::size_t>(width)};
}

}  // namespace

std::vector<char> encodeExr(const Image& image) {
  assert(image.width > 0 && image.height > 0);
  try {
    Imf::Header header(image.width, image.height);
    header.compression() = Imf::ZIP_COMPRESSION;
    Imf::addChromaticities(header, Imf::Chromaticities());  // the default is Rec. 709
    if (image.pixels_per_inch > 0.0)
      Imf::addXDensity(header, static_cast<float>(image.pixels_per_inch));
    Imf::FrameBuffer frame;
    std::deque<std::vector<half>> halves;
    const auto addHalf = [&](const char* name, const std::vector<float>& values, std::size_t first,
                             std::size_t step) {
      std::vector<half>& channel = halves.emplace_back();
      for (std::size_t i = first; i < values.size(); i += step)
        channel.push_back(toHalf(values[i]));
      header.channels().insert(name, Imf::Channel(Imf::HALF));
      frame.insert(name, sliceOf(Imf::HALF, channel.data(), sizeof(half), image.width));
    };
    addHalf("R", image.rgb, 0, 3);
    addHalf("G", image.rgb, 1, 3);
    addHalf("B", image.rgb, 2, 3);
    if (!image.alpha.empty()) addHalf("A", image.alpha, 0, 1);
    if (!image.normals.empty()) {
      addHalf("N.X", image.normals, 0, 3);
      addHalf("N.Y", image.normals, 1, 3);
      addHalf("N.Z", image.normals, 2, 3);
    }
    if (!image.depth.empty()) {
      header.channels().insert("Z", Imf::Channel(Imf::FLOAT));
      // Only reads, although the library's signature is not const.
      frame.insert("Z", sliceOf(Imf::FLOAT, const_cast<float*>(image.depth.data()), sizeof(float),
                                image.width));
    }

    MemoryStream stream;
    {
      // The destructor completes the table of line offsets, so it runs before the bytes are taken.
      Imf::OutputFile file(stream, header);
      file.setFrameBuffer(frame);
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
