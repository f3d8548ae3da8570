// A picture in memory.
#pragma once

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <utility>
#include <vector>

#include "isobrick/extract/color_map.h"

namespace isobrick {

// An RGB picture with linear light (twice the value is twice the light) and the primaries of Rec.
// 709, which are those of sRGB. 0 is black and 1 is the white of a screen; greater values are kept
// by EXR and clipped by PNG. Averaging pixels and EXR need linear light; the sRGB curve is applied
// once, on the way to 8 bits.
struct Image {
  int width = 0;   // pixels
  int height = 0;  // pixels
  // 3 floats a pixel, rows from top to bottom, pixels from left to right: width * height * 3.
  std::vector<float> rgb;
  // Further layers of a picture, a value or three for each pixel; empty: it has none.
  std::vector<float> alpha = {};    // 0 .. 1, and then `rgb` is premultiplied with it; else opaque
  std::vector<float> depth = {};    // along the camera's forward axis, world units; infinity: none
  std::vector<float> normals = {};  // three a pixel: outward, world, unit; 0: none
  // Pixels per inch of a print, which both formats keep; 0: they say nothing.
  double pixels_per_inch = 0.0;

  // The position of a pixel's first float in `rgb`.
  std::size_t offsetOf(int x, int y) const {
    assert(x >= 0 && x < width && y >= 0 && y < height);
    return 3 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                static_cast<std::size_t>(x));
  }
};

// The 8-bit screen value nearest to a linear one. toSrgb8(linearFromSrgb(k / 255)) is k.
inline std::uint8_t toSrgb8(float linear) {
  return static_cast<std::uint8_t>(std::lround(255.0f * srgbFromLinear(linear)));
}

// A picture from 8-bit sRGB values in the order of Image::rgb, for instance a window's contents.
// Written as PNG it gives the same bytes again.
inline Image imageFromSrgb8(int width, int height, std::span<const std::uint8_t> rgb) {
  assert(width >= 0 && height >= 0);
  assert(rgb.size() == static_cast<std::size_t>(width) * static_cast<std::size_t>(height) * 3);
  Image image{width, height, std::vector<float>(rgb.size())};
  std::transform(rgb.begin(), rgb.end(), image.rgb.begin(), [](std::uint8_t value) {
    return linearFromSrgb(static_cast<float>(value) / 255.0f);
  });
  return image;
}

// Greatest width and height of a picture that is drawn, pixels. It is drawn in tiles and written in
// bands, so memory does not bound it.
inline constexpr int kMostPictureSide = 500'000;

// By the extension of the name.
enum class ImageFormat {
  kPng,  // .png
  kExr,  // .exr
};

// The formats by their extensions.
inline constexpr std::pair<const char*, ImageFormat> kImageFormats[] = {
    {".png", ImageFormat::kPng}, {".exr", ImageFormat::kExr}};

// The format of a file name by its extension, in upper or lower case. Throws Error for any other
// extension; check it before long work, so that a mistyped name costs nothing.
ImageFormat imageFormatOf(const std::filesystem::path& path);

// Writes `image` in the format of the extension. The file appears under its name only when it is
// complete, and replaces an older one. If writing fails, nothing is left behind and Error names the
// path. Safe to call from
// several threads for different paths.
void writeImage(const std::filesystem::path& path, const Image& image);

// The picture, which has at least one pixel, as the bytes of a file of that format. Throws Error
// (without a path).
// PNG: RGB, or RGBA not premultiplied, 8 bits, sRGB curve, values clipped to 0..1; no other layers.
// The size of a print is kept as whole pixels per metre.
// EXR: one part of scan lines, channels R, G, B and, if there is alpha, A (premultiplied) as
// half floats (11 significant bits, values clipped to +-65504), ZIP compression, chromaticities of
// Rec. 709. Depth is the channel Z, as 32-bit floats; normals are N.X, N.Y and N.Z, as half floats.
std::vector<char> encodeImage(ImageFormat format, const Image& image);

}  // namespace isobrick
