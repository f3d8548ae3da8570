#include <cassert>
#include <cstring>
#include <string>
#include <utility>

#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/lowercase.h"
#include "isobrick/viewer/image.h"
#include "isobrick/viewer/picture_bands.h"

namespace isobrick {

ImageFormat imageFormatOf(const std::filesystem::path& path) {
  const std::string extension = lowerExtension(path);
  for (const auto& [known, format] : kImageFormats)
    if (extension == known) return format;
  throw Error("cannot write picture " + path.string() + ": unknown extension '" + extension +
              "'; name it .png or .exr");
}

PictureShape shapeOf(const Image& image) {
  return {image.width,          image.height,           !image.alpha.empty(),
          !image.depth.empty(), !image.normals.empty(), image.pixels_per_inch};
}

std::unique_ptr<BandEncoder> makeBandEncoder(ImageFormat format, const PictureShape& shape,
                                             WriteAt write) {
  return format == ImageFormat::kPng ? makePngEncoder(shape, std::move(write))
                                     : makeExrEncoder(shape, std::move(write));
}

void MemoryFile::write(const void* data, std::size_t bytes, std::uint64_t offset) {
  if (bytes == 0) return;
  if (offset + bytes > bytes_.size()) bytes_.resize(offset + bytes);
  std::memcpy(bytes_.data() + offset, data, bytes);
}

std::vector<char> encodeImage(ImageFormat format, const Image& image) {
  assert(image.width > 0 && image.height > 0);
  MemoryFile file;
  const auto encoder = makeBandEncoder(
      format, shapeOf(image), [&](const void* data, std::size_t bytes, std::uint64_t offset) {
        file.write(data, bytes, offset);
      });
  encoder->add(image);
  encoder->finish();
  return file.take();
}

std::vector<char> encodePng(const Image& image) { return encodeImage(ImageFormat::kPng, image); }
std::vector<char> encodeExr(const Image& image) { return encodeImage(ImageFormat::kExr, image); }

void writeImage(const std::filesystem::path& path, const Image& image) {
  const ImageFormat format = imageFormatOf(path);
  AtomicFile file(path.string());
  const auto encoder = makeBandEncoder(
      format, shapeOf(image), [&](const void* data, std::size_t bytes, std::uint64_t offset) {
        file.pwrite(data, bytes, offset);
      });
  encoder->add(image);
  encoder->finish();
  file.commit();
}

}  // namespace isobrick
