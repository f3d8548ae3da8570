#include "isobrick/viewer/image.h"

#include <cassert>
#include <string>

#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/lowercase.h"
#include "isobrick/viewer/picture_writer.h"

namespace isobrick {

ImageFormat imageFormatOf(const std::filesystem::path& path) {
  const std::string extension = lowerExtension(path);
  for (const auto& [known, format] : kImageFormats)
    if (extension == known) return format;
  throw Error("cannot write picture " + path.string() + ": unknown extension '" + extension +
              "'; name it .png or .exr");
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
