// The fine side of a face between a leaf and finer ones (rule 10; Sect. 3 of the paper).
#pragma once

#include <algorithm>

#include "isobrick/extract/kernels/contour.h"
#include "isobrick/extract/meshing/corner_values.h"

namespace isobrick {

// 2x2 faces of finer leaves, fewer if the cell is too thin to be halved, between 3x3 points whose
// values the four corners of the coarse face determine (fillFace()).
struct TransitionFace {
  int axis = 0, side = 0;        // of the coarse cell
  int b = 1, c = 2;              // the axes of the face
  int parts_b = 2, parts_c = 2;  // faces along them: 1 or 2
  int level = 0;                 // the finer one
  Index3 first{0};               // its sample of point (0, 0)
  float values[3][3];            // [j][i]: i along b, j along c, up to the number of parts

  LatticePoint point(int i, int j) const {
    LatticePoint out{values[j][i], level, first};
    out.sample[b] += i;
    out.sample[c] += j;
    return out;
  }
};

// Face `face` of leaf `cell` of `level`, which is not 0. `corners`: the values of the leaf's
// corners by rule 6, corner x + 2y + 4z; only those of the face count.
inline TransitionFace makeTransitionFace(const Lattice& lattice, int level, const Index3& cell,
                                         int face, const float (&corners)[8]) {
  TransitionFace out;
  out.axis = face / 2;
  out.side = face % 2;
  out.b = (out.axis + 1) % 3;
  out.c = (out.axis + 2) % 3;
  out.level = level - 1;
  const Index3 last = lattice.samples(out.level) - Index3(1);
  const int parts_b = out.parts_b = 2 * cell[out.b] + 2 <= last[out.b] ? 2 : 1;
  const int parts_c = out.parts_c = 2 * cell[out.c] + 2 <= last[out.c] ? 2 : 1;
  out.first = std::int64_t{2} * cell;
  out.first[out.axis] = std::min(2 * (cell[out.axis] + out.side), last[out.axis]);
  const auto valueOf = [&](int b, int c) {
    return corners[(out.side << out.axis) + (b << out.b) + (c << out.c)];
  };
  auto& values = out.values;
  values[0][0] = valueOf(0, 0);
  values[0][parts_b] = valueOf(1, 0);
  values[parts_c][0] = valueOf(0, 1);
  values[parts_c][parts_b] = valueOf(1, 1);
  fillFace(lattice, out.level, out.first, {out.b, out.c}, {parts_b, parts_c}, values);
  return out;
}

// Adds the contour on the fine side. numberOf(edge) looks up the vertex of one of the cell's edges;
// makeVertex(axis, low, high) makes that of an edge between two LatticePoints inside the face; such
// an edge belongs to no other leaf of the level, and is made once.
template <typename Find, typename Make>
void addTransitionFace(const TransitionFace& face, float isovalue, Find&& numberOf,
                       Make&& makeVertex, Contour& contour) {
  const int number = 2 * face.axis + face.side;
  const auto& points = kHalvedFacePoints[static_cast<std::size_t>(number)];
  const auto pointOf = [&](std::uint8_t edge) {
    const std::uint8_t point = points[edge];
    if (contour.isKnown(point)) return point;
    if (point < kCellEdges) {
      contour.setNumber(point, numberOf(point));
    } else {
      const bool along_b = edge < 6;
      const int part = edge % 2, i = along_b ? part : 1, j = along_b ? 1 : part;
      contour.setNumber(point, makeVertex(along_b ? face.b : face.c, face.point(i, j),
                                          along_b ? face.point(i + 1, j) : face.point(i, j + 1)));
    }
    return point;
  };
  unsigned inside = 0;
  for (int j = 0; j <= face.parts_c; ++j)
    for (int i = 0; i <= face.parts_b; ++i)
      inside |= static_cast<unsigned>(face.values[j][i] >= isovalue) << (3 * j + i);
  const bool is_halved = face.parts_b == 2 && face.parts_c == 2;
  const FaceContour pieces = is_halved
                                 ? halvedFace(face.side, inside)
                                 : makeHalvedFace(face.side, inside, {face.parts_b, face.parts_c});
  for (std::size_t n = 0; n < pieces.size; ++n) {
    // One after the other: the order in which vertices are made is part of the mesh (rule 13).
    const std::uint8_t to = pointOf(pieces.pieces[n].to);
    const std::uint8_t from = pointOf(pieces.pieces[n].from);
    contour.add(from, to, number);
  }
}

}  // namespace isobrick
