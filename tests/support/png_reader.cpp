#include "tests/support/png_reader.h"

#include <png.h>

#include "isobrick/storage/error.h"

namespace isobrick::test {
namespace {

// Frees what libpng keeps for a picture that is read.
class PngReading {
 public:
  PngReading() { png_.version = PNG_IMAGE_VERSION; }
  ~PngReading() { png_image_free(&png_); }
  PngReading(const PngReading&) = delete;
  PngReading& operator=(const PngReading&) = delete;

  png_image* get() { return &png_; }
  const png_image& operator*() const { return png_; }

 private:
  png_image png_{};
};

}  // namespace

PictureBytes readPng(const std::string& path, int most_side) {
  PngReading png;
  const auto fail = [&](const std::string& why) {
    throw Error("cannot read the picture '" + path + "': " + why, {path});
  };
  if (png_image_begin_read_from_file(png.get(), path.c_str()) == 0) fail((*png).message);
  const auto most = static_cast<png_uint_32>(most_side);
  if ((*png).width > most || (*png).height > most)
    fail("it has more than " + std::to_string(most_side) + " pixels to a side");
  png.get()->format = PNG_FORMAT_RGBA;
  PictureBytes picture{static_cast<int>((*png).width), static_cast<int>((*png).height)};
  picture.rgba.resize(PNG_IMAGE_SIZE(*png));
  if (png_image_finish_read(png.get(), nullptr, picture.rgba.data(), 0, nullptr) == 0)
    fail((*png).message);
  return picture;
}

}  // namespace isobrick::test
