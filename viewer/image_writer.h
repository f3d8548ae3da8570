// Pictures to files: .png (8-bit sRGB) and .exr (16-bit half floats, linear).
#pragma once

#include <cstddef>
#include <filesystem>
#include <utility>
#include <vector>

#include "isobrick/viewer/image.h"

namespace isobrick {

// By the extension of the name.
enum class ImageFormat {
  kPng,  // .png
  kExr,  // .exr
};

// The formats by their extensions.
inline constexpr std::pair<const char*, ImageFormat> kImageFormats[] = {
    {".png", ImageFormat::kPng}, {".exr", ImageFormat::kExr}};

// The format that a file name asks for by its extension, in upper or lower case. Throws Error for
// any other extension: ask before long work, so that a slip of the pen costs nothing.
ImageFormat imageFormatOf(const std::filesystem::path& path);

// Writes `image` in the format that the extension asks for. The file appears under its name only
// when it is complete, replacing what was there; when writing fails nothing is left behind and
// Error names the path. Holds the encoded file in memory (at most the size of the pixels).
// Safe to call from several threads for different paths.
void writeImage(const std::filesystem::path& path, const Image& image);

// The picture as the bytes of a file of that format.
std::vector<char> encodeImage(ImageFormat format, const Image& image);

// The bytes of a file. `image` has at least one pixel. Throws Error (without a path).
// PNG: RGB, or RGBA not premultiplied, 8 bits, sRGB curve, values clipped to 0..1; no other layers.
std::vector<char> encodePng(const Image& image);
// EXR: one part of scan lines, channels R, G, B and, where there is alpha, A (premultiplied) as
// half floats (11 significant bits, values clipped to +-65504), ZIP compression, chromaticities of
// Rec. 709. Depth is the channel Z, as 32-bit floats; normals are N.X, N.Y and N.Z, as half floats.
std::vector<char> encodeExr(const Image& image);

}  // namespace isobrick
