// The fine side of a face between a leaf and finer ones (rule 10; Sect. 3 of the paper).
#pragma once

#include <algorithm>

#include "isobrick/extract/kernels/contour.h"
#include "isobrick/extract/meshing/corner_values.h"

namespace isobrick {

// 2x2 faces of finer leaves, fewer where the cell is too thin to be halved, between 3x3 points
// whose values the four corners of the coarse face determine (rule 6).
struct TransitionFace {
  int axis = 0, side = 0;        // of the coarse cell
  int b = 1, c = 2;              // the axes of the face
  int parts_b = 2, parts_c = 2;  // faces along them: 1 or 2
  LatticePoint points[3][3];     // [j][i]: i along b, j along c, up to the number of parts
};

// Face `face` of leaf `cell` of `level`, which is not 0.
TransitionFace makeTransitionFace(const Lattice& lattice, int level, const Index3& cell, int face,
                                  const TileCorners& corners);

// A point of a transition face: points[j][i].
struct FacePoint {
  int i = 0, j = 0;
};

// Adds the contour on the fine side. Edges of the coarse cell have their vertex in `vertices`;
// vertexOn(axis, low, high) gives that of an edge between two LatticePoints inside the face.
template <typename F>
void addTransitionFace(const TransitionFace& face, float isovalue, const CellVertices& vertices,
                       F&& vertexOn, Contour& contour) {
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
    const LatticePoint& high = along_b ? face.points[j][i + 1] : face.points[j + 1][i];
    return vertexOn(along_b ? face.b : face.c, face.points[j][i], high);
  };
  for (int part_c = 0; part_c < face.parts_c; ++part_c)
    for (int part_b = 0; part_b < face.parts_b; ++part_b) {
      FacePoint corner[4];
      bool inside[4];
      for (int n = 0; n < 4; ++n) {
        const FaceCorner at = kFaceLoop[face.side][n];
        corner[n] = {part_b + at.b, part_c + at.c};
        inside[n] = face.points[corner[n].j][corner[n].i].value >= isovalue;
      }
      forEachFaceSegment(inside, [&](int m, int n) {
        // One after the other: the order in which vertices are made is part of the mesh (rule 13).
        const std::uint32_t to = vertexBetween(corner[n], corner[(n + 1) % 4]);
        const std::uint32_t from = vertexBetween(corner[(m + 3) % 4], corner[m]);
        contour.add(from, to);
      });
    }
}

}  // namespace isobrick
