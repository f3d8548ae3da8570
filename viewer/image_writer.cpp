#include <png.h>
#include <zlib.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <string>

#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/lowercase.h"
#include "isobrick/viewer/image.h"

namespace isobrick {

ImageFormat imageFormatOf(const std::filesystem::path& path) {
  const std::string extension = lowerExtension(path);
  for (const auto& [known, format] : kImageFormats)
    if (extension == known) return format;
  throw Error("cannot write picture " + path.string() + ": unknown extension '" + extension +
              "'; name it .png or .exr");
}

namespace {

// PNG stores colours that are not premultiplied, and alpha beside them.
std::vector<std::uint8_t> pngPixels(const Image& image) {
  std::vector<std::uint8_t> pixels;
  if (image.alpha.empty()) {
    pixels.resize(image.rgb.size());
    std::transform(image.rgb.begin(), image.rgb.end(), pixels.begin(), toSrgb8);
    return pixels;
  }
  pixels.reserve(4 * image.alpha.size());
  for (std::size_t i = 0; i < image.alpha.size(); ++i) {
    const float alpha = std::clamp(image.alpha[i], 0.0f, 1.0f);
    for (std::size_t c = 0; c < 3; ++c)
      pixels.push_back(alpha > 0.0f ? toSrgb8(image.rgb[3 * i + c] / alpha) : std::uint8_t{0});
    pixels.push_back(static_cast<std::uint8_t>(std::lround(255.0f * alpha)));
  }
  return pixels;
}

void appendBigEndian(std::uint32_t value, std::vector<char>& bytes) {
  for (const unsigned shift : {24u, 16u, 8u, 0u})
    bytes.push_back(static_cast<char>(value >> shift & 0xff));
}

// The chunk of the size of a print, which libpng's simplified interface does not write: pixels per
// metre along both sides. It stands after the header, the first 33 bytes.
void insertPrintSize(double pixels_per_inch, std::vector<char>& png) {
  constexpr std::size_t kHeaderEnd = 33;
  const auto per_metre = static_cast<std::uint32_t>(std::lround(pixels_per_inch / 0.0254));
  std::vector<char> content{'p', 'H', 'Y', 's'};
  appendBigEndian(per_metre, content);
  appendBigEndian(per_metre, content);
  content.push_back(1);  // the unit is the metre
  std::vector<char> chunk;
  appendBigEndian(9, chunk);
  chunk.insert(chunk.end(), content.begin(), content.end());
  const auto* const bytes = reinterpret_cast<const unsigned char*>(content.data());
  appendBigEndian(
      static_cast<std::uint32_t>(crc32(0, bytes, static_cast<unsigned>(content.size()))), chunk);
  png.insert(png.begin() + kHeaderEnd, chunk.begin(), chunk.end());
}

}  // namespace

std::vector<char> encodePng(const Image& image) {
  assert(image.width > 0 && image.height > 0);
  const std::vector<std::uint8_t> pixels = pngPixels(image);

  // libpng's simplified interface reports errors by return value; the full one jumps out with
  // longjmp, past C++ destructors.
  png_image description{};
  description.version = PNG_IMAGE_VERSION;
  description.width = static_cast<png_uint_32>(image.width);
  description.height = static_cast<png_uint_32>(image.height);
  description.format = image.alpha.empty() ? PNG_FORMAT_RGB : PNG_FORMAT_RGBA;
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
  if (image.pixels_per_inch > 0.0) insertPrintSize(image.pixels_per_inch, encoded);
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
