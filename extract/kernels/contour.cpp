#include "isobrick/extract/kernels/contour.h"

namespace isobrick {

const FaceContour& halvedFace(int side, unsigned inside_bits) {
  static const auto kTable = [] {
    std::array<std::array<FaceContour, 512>, 2> table;
    for (int s = 0; s < 2; ++s)
      for (unsigned bits = 0; bits < 512; ++bits)
        table[static_cast<std::size_t>(s)][bits] = makeHalvedFace(s, bits);
    return table;
  }();
  return kTable[static_cast<std::size_t>(side)][inside_bits];
}

const FaceContour& plainFace(int face, unsigned pattern) {
  static const auto kTable = [] {
    std::array<std::array<FaceContour, 256>, 6> table;
    for (int f = 0; f < 6; ++f)
      for (unsigned p = 0; p < 256; ++p)
        table[static_cast<std::size_t>(f)][p] = makePlainFace(f, p);
    return table;
  }();
  return kTable[static_cast<std::size_t>(face)][pattern];
}

}  // namespace isobrick
