#include "isobrick/extract/kernels/contour.h"

#include <bit>

namespace isobrick {

void addPlainFace(unsigned pattern, int face, const CellVertices& vertices, Contour& contour) {
  const int axis = face / 2, side = face % 2;
  int corner[4];
  bool inside[4];
  for (int i = 0; i < 4; ++i) {
    const FaceCorner at = kFaceLoop[side][i];
    corner[i] = side << axis | at.b << (axis + 1) % 3 | at.c << (axis + 2) % 3;
    inside[i] = (pattern >> corner[i] & 1) != 0;
  }
  const auto vertexBetween = [&](int i, int j) {
    const int low = corner[i] & corner[j];
    const auto along = static_cast<unsigned>(corner[i] ^ corner[j]);
    return vertices[static_cast<std::size_t>(
        edgeNumber(std::countr_zero(along), low & 1, low >> 1 & 1, low >> 2))];
  };
  forEachFaceSegment(inside, [&](int i, int j) {
    contour.add(vertexBetween((i + 3) % 4, i), vertexBetween(j, (j + 1) % 4), face);
  });
}

}  // namespace isobrick
