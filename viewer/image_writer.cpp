#include "isobrick/viewer/image_writer.h"

#include <png.h>

#include <algorithm>
#include <cassert>
#include <string>

#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {

ImageFormat imageFormatOf(const std::filesystem::path& path) {
  const std::string extension = lowerExtension(path);
  if (extension == ".png") return ImageFormat::kPng;
  if (extension == ".exr") return ImageFormat::kExr;
  throw Error("cannot write picture " + path.string() + ": unknown extension '" + extension +
              "'; name it .png or .exr");
}

std::vector<char> encodePng(const Image& image) {
  assert(image.width > 0 && image.height > 0);
  std::vector<std::uint8_t> pixels(image.rgb.size());
  std::transform(image.rgb.begin(), image.rgb.end(), pixels.begin(), toSrgb8);

  // libpng's simplified interface reports errors by return value; the full one jumps out with
  // longjmp, past C++ destructors.
  png_image description{};
  description.version = PNG_IMAGE_VERSION;
  description.width = static_cast<png_uint_32>(image.width);
  description.height = static_cast<png_uint_32>(image.height);
  description.format = PNG_FORMAT_RGB;
  png_alloc_size_t bytes = PNG_IMAGE_PNG_SIZE_MAX(description);
  std::vector<char> encoded(bytes);
  const int converted_to_8_bit = 0;
  const png_int_32 packed_rows = 0;
  if (!png_image_write_to_memory(&description, encoded.data(), &bytes, converted_to_8_bit,
                                 pixels.data(), packed_rows, nullptr)) {
    throw Error("cannot encode a PNG picture of " + std::to_string(image.width) + " x " +
                std::to_string(image.height) + " pixels: " + description.message +
                "; try a smaller picture");
  }
  encoded.resize(bytes);
  return encoded;
}

std::vector<char> encodeImage(ImageFormat format, const Image& image) {
  return format == ImageFormat::kPng ? encodePng(image) : encodeExr(image);
}

void writeImage(const std::filesystem::path& path, const Image& image) {
  const std::vector<char> encoded = encodeImage(imageFormatOf(path), image);
  AtomicFile file(path.string());
  file.write(encoded.data(), encoded.size());
  file.commit();
}

}  // namespace isobrick
