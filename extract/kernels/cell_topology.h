// The numbering of a cell's corners, edges and faces; the one place that defines it.
#pragma once

#include <array>
#include <cstdint>

namespace isobrick {

// Corner c = x + 2y + 4z with x, y, z in {0, 1}.
//
// Edge e = 4 * axis + u + 2v: it runs along `axis`; u and v are its offsets along the other two
// axes in ascending order (x: y, z; y: x, z; z: x, y).
//
// Face f = 2 * axis + side.
inline constexpr int kCellEdges = 12;

struct CellEdge {
  std::uint8_t axis;
  std::uint8_t x, y, z;    // lower end, relative to the cell's lowest corner
  std::uint8_t low, high;  // corners
};

constexpr int edgeNumber(int axis, int x, int y, int z) {
  const int u = axis == 0 ? y : x;
  const int v = axis == 2 ? y : z;
  return 4 * axis + u + 2 * v;
}

constexpr std::array<CellEdge, kCellEdges> makeCellEdges() {
  std::array<CellEdge, kCellEdges> edges{};
  for (int axis = 0; axis < 3; ++axis)
    for (int corner = 0; corner < 8; ++corner) {
      if ((corner >> axis & 1) != 0) continue;
      const int x = corner & 1, y = corner >> 1 & 1, z = corner >> 2;
      edges[static_cast<std::size_t>(edgeNumber(axis, x, y, z))] = {
          static_cast<std::uint8_t>(axis),   static_cast<std::uint8_t>(x),
          static_cast<std::uint8_t>(y),      static_cast<std::uint8_t>(z),
          static_cast<std::uint8_t>(corner), static_cast<std::uint8_t>(corner | 1 << axis)};
    }
  return edges;
}
inline constexpr std::array<CellEdge, kCellEdges> kCellEdgeTable = makeCellEdges();

// The corners of face `face`, a bit each.
constexpr unsigned faceCorners(int face) {
  unsigned corners = 0;
  for (int corner = 0; corner < 8; ++corner)
    if ((corner >> face / 2 & 1) == face % 2) corners |= 1u << corner;
  return corners;
}

// The corners of a unit square, counter-clockwise seen from outside, for a face on the given side:
// offsets along the axes (axis + 1) % 3 and (axis + 2) % 3.
struct FaceCorner {
  std::uint8_t b, c;
};
inline constexpr FaceCorner kFaceLoop[2][4] = {
    {{0, 0}, {0, 1}, {1, 1}, {1, 0}},  // side 0: the outward normal is the negative axis
    {{0, 0}, {1, 0}, {1, 1}, {0, 1}},  // side 1
};

// The contour on one face whose corners, counter-clockwise seen from outside, are inside or not:
// calls `segment(i, j)` for every piece, which runs from the face edge between corners i - 1 and i
// to that between corners j and j + 1 (all modulo 4). Every run of inside corners is cut off by a
// piece of its own, so the inside corners of an ambiguous face stay apart (rule 9), and the inside
// lies to the right, so that a cell's polygons are counter-clockwise seen from the lower values.
template <typename F>
constexpr void forEachFaceSegment(const bool (&inside)[4], F&& segment) {
  for (int i = 0; i < 4; ++i) {
    if (!inside[i] || inside[(i + 3) % 4]) continue;
    int j = i;
    while (inside[(j + 1) % 4]) j = (j + 1) % 4;
    segment(i, j);
  }
}

}  // namespace isobrick
