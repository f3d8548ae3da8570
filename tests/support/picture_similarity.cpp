#include "tests/support/picture_similarity.h"

namespace isobrick::test {
namespace {

constexpr int kSquare = 8;

// The similarity of one channel in the square with its upper left corner at `left`, `top`.
double similarityAt(const PictureBytes& a, const PictureBytes& b, int left, int top,
                    std::size_t channel) {
  constexpr double kSteady1 = 6.5025, kSteady2 = 58.5225;  // (0.01 * 255)^2, (0.03 * 255)^2
  double ma = 0, mb = 0, aa = 0, bb = 0, ab = 0;
  for (int y = top; y < top + kSquare; ++y) {
    for (int x = left; x < left + kSquare; ++x) {
      const double va = a.rgba[a.offsetOf(x, y) + channel];
      const double vb = b.rgba[b.offsetOf(x, y) + channel];
      ma += va, mb += vb, aa += va * va, bb += vb * vb, ab += va * vb;
    }
  }
  constexpr double kCount = kSquare * kSquare;
  ma /= kCount, mb /= kCount;
  const double sa = aa / kCount - ma * ma, sb = bb / kCount - mb * mb;
  const double sab = ab / kCount - ma * mb;
  return (2 * ma * mb + kSteady1) * (2 * sab + kSteady2) /
         ((ma * ma + mb * mb + kSteady1) * (sa + sb + kSteady2));
}

}  // namespace

PictureBytes bytesOf(const Image& image) {
  PictureBytes bytes{image.width, image.height};
  for (std::size_t i = 0; i < image.rgb.size(); i += 3) {
    for (std::size_t c = 0; c < 3; ++c) bytes.rgba.push_back(toSrgb8(image.rgb[i + c]));
    bytes.rgba.push_back(255);
  }
  return bytes;
}

double similarity(const PictureBytes& a, const PictureBytes& b) {
  if (a.width != b.width || a.height != b.height) return 0.0;
  double sum = 0.0;
  int count = 0;
  for (int top = 0; top + kSquare <= a.height; top += kSquare)
    for (int left = 0; left + kSquare <= a.width; left += kSquare)
      for (std::size_t channel = 0; channel < 3; ++channel, ++count)
        sum += similarityAt(a, b, left, top, channel);
  return sum / count;
}

}  // namespace isobrick::test
