// The fine side of a face between a leaf and finer ones (rule 10; Sect. 3 of the paper).
#pragma once

#include <algorithm>

#include "isobrick/extract/kernels/contour.h"
#include "isobrick/extract/meshing/corner_values.h"

namespace isobrick {

// 2x2 faces of finer leaves, fewer where the cell is too thin to be halved, between 3x3 points
// whose values the four corners of the coarse face determine (fillFace()).
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

// A point of a transition face: values[j][i].
struct FacePoint {
  int i = 0, j = 0;
};

// Adds the contour on the fine side. Edges of the coarse cell have their vertex in `vertices`;
// makeVertex(axis, low, high) makes that of an edge between two LatticePoints inside the face; such
// an edge is no other leaf's of the level, and is asked for once.
template <typename F>
void addTransitionFace(const TransitionFace& face, float isovalue, const CellVertices& vertices,
                       F&& makeVertex, Contour& contour) {
  std::uint32_t inner[2][2] = {{kNoVertex, kNoVertex}, {kNoVertex, kNoVertex}};  // along c, b
  const auto vertexBetween = [&](FacePoint p, FacePoint q) {
    const int i = std::min(p.i, q.i), j = std::min(p.j, q.j);
    const bool along_b = p.i != q.i;
    const bool on_cell_edge = along_b ? j == 0 || j == face.parts_c : i == 0 || i == face.parts_b;
    if (on_cell_edge) {
      int at[3] = {0, 0, 0};
      at[face.axis] = face.side;
      at[along_b ? face.c : face.b] = (along_b ? j : i) == 0 ? 0 : 1;
      return vertices[static_cast<std::size_t>(
          edgeNumber(along_b ? face.b : face.c, at[0], at[1], at[2]))];
    }
    std::uint32_t& vertex = inner[along_b ? 1 : 0][along_b ? i : j];
    if (vertex == kNoVertex) {
      const LatticePoint high = along_b ? face.point(i + 1, j) : face.point(i, j + 1);
      vertex = makeVertex(along_b ? face.b : face.c, face.point(i, j), high);
    }
    return vertex;
  };
  for (int part_c = 0; part_c < face.parts_c; ++part_c)
    for (int part_b = 0; part_b < face.parts_b; ++part_b) {
      FacePoint corner[4];
      bool inside[4];
      for (int n = 0; n < 4; ++n) {
        const FaceCorner at = kFaceLoop[face.side][n];
        corner[n] = {part_b + at.b, part_c + at.c};
        inside[n] = face.values[corner[n].j][corner[n].i] >= isovalue;
      }
      forEachFaceSegment(inside, [&](int m, int n) {
        // One after the other: the order in which vertices are made is part of the mesh (rule 13).
        const std::uint32_t to = vertexBetween(corner[n], corner[(n + 1) % 4]);
        const std::uint32_t from = vertexBetween(corner[(m + 3) % 4], corner[m]);
        contour.add(from, to, 2 * face.axis + face.side);
      });
    }
}

}  // namespace isobrick
