// The numbering of a cell's corners, edges and faces, which is defined here alone; and the lines in
// which the isosurface cuts the faces of one cell: pieces from point to point, and the loops that
// they close (rules 9 and 10).
#pragma once

#include <array>
#include <cstdint>
#include <span>

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

// The number of a vertex that does not exist. In a sound pyramid every crossing that a kernel looks
// up has its vertex; if ranges hide samples, or values are not finite, they find this number.
inline constexpr std::uint32_t kNoVertex = ~std::uint32_t{0};

// The points of a cell's contour: first its edges, then, for each face, the four edges inside it if
// it is halved both ways.
inline constexpr int kContourPoints = kCellEdges + 6 * 4;

// The contour on one face: at most four halves of halves with two pieces each. Each runs from one
// edge to another, in the numbers of a table below.
struct FaceContour {
  struct Piece {
    std::uint8_t from, to;
  };
  std::array<Piece, 8> pieces{};
  std::uint8_t size = 0;
};

// Edges of a halved face: 2 j + i is part i (0, 1) along b of row j (0 .. 2), 6 + 2 i + j part j
// along c of column i; b and c are the axes (axis + 1) % 3 and (axis + 2) % 3 of face 2 axis +
// side. If it is not halved along an axis, only part 0 and the lines 0 and 2 are there.
inline constexpr int kHalvedFaceEdges = 12;
struct FaceParts {
  int b = 2, c = 2;  // 1 or 2
};
constexpr int halvedFaceEdge(const FaceParts& parts, FaceCorner p, FaceCorner q) {
  if (p.b != q.b) return 2 * (p.c == parts.c ? 2 : p.c) + (p.b < q.b ? p.b : q.b);
  return 6 + 2 * (p.b == parts.b ? 2 : p.b) + (p.c < q.c ? p.c : q.c);
}

// The contour on a face of side `side` (0, 1) that is halved: bit 3 j + i of `inside` says so of
// point (i, j), 0 .. parts of each.
constexpr FaceContour makeHalvedFace(int side, unsigned inside_bits, const FaceParts& parts = {}) {
  FaceContour contour;
  for (int part_c = 0; part_c < parts.c; ++part_c)
    for (int part_b = 0; part_b < parts.b; ++part_b) {
      FaceCorner corner[4]{};
      bool inside[4]{};
      for (int n = 0; n < 4; ++n) {
        const FaceCorner at = kFaceLoop[side][n];
        corner[n] = {static_cast<std::uint8_t>(part_b + at.b),
                     static_cast<std::uint8_t>(part_c + at.c)};
        inside[n] = (inside_bits >> (3 * corner[n].c + corner[n].b) & 1) != 0;
      }
      forEachFaceSegment(inside, [&](int m, int n) {
        contour.pieces[contour.size++] = {
            static_cast<std::uint8_t>(halvedFaceEdge(parts, corner[(m + 3) % 4], corner[m])),
            static_cast<std::uint8_t>(halvedFaceEdge(parts, corner[n], corner[(n + 1) % 4]))};
      });
    }
  return contour;
}

// The contour on face `face` of a cell, in the cell's edges: bit c of `pattern` says whether corner
// c is inside.
constexpr FaceContour makePlainFace(int face, unsigned pattern) {
  const int axis = face / 2, side = face % 2;
  int corner[4]{};
  bool inside[4]{};
  for (int i = 0; i < 4; ++i) {
    const FaceCorner at = kFaceLoop[side][i];
    corner[i] = side << axis | at.b << (axis + 1) % 3 | at.c << (axis + 2) % 3;
    inside[i] = (pattern >> corner[i] & 1) != 0;
  }
  const auto edgeBetween = [&](int i, int j) {
    const int low = corner[i] & corner[j], along = corner[i] ^ corner[j];
    return static_cast<std::uint8_t>(edgeNumber(along >> 1, low & 1, low >> 1 & 1, low >> 2));
  };
  FaceContour contour;
  forEachFaceSegment(inside, [&](int i, int j) {
    contour.pieces[contour.size++] = {edgeBetween((i + 3) % 4, i), edgeBetween(j, (j + 1) % 4)};
  });
  return contour;
}

// The same for faces halved both ways, and for a cell's, from a table.
inline const FaceContour& halvedFace(int side, unsigned inside_bits) {
  static const auto kTable = [] {
    std::array<std::array<FaceContour, 512>, 2> table;
    for (int s = 0; s < 2; ++s)
      for (unsigned bits = 0; bits < 512; ++bits)
        table[static_cast<std::size_t>(s)][bits] = makeHalvedFace(s, bits);
    return table;
  }();
  return kTable[static_cast<std::size_t>(side)][inside_bits];
}

inline const FaceContour& plainFace(int face, unsigned pattern) {
  static const auto kTable = [] {
    std::array<std::array<FaceContour, 256>, 6> table;
    for (int f = 0; f < 6; ++f)
      for (unsigned p = 0; p < 256; ++p)
        table[static_cast<std::size_t>(f)][p] = makePlainFace(f, p);
    return table;
  }();
  return kTable[static_cast<std::size_t>(face)][pattern];
}

// The point of a contour that an edge of a halved face is: the cell's edge that it is half of, or
// one inside the face.
constexpr std::uint8_t contourPoint(int face, int halved_face_edge) {
  const int axis = face / 2, b = (axis + 1) % 3, c = (axis + 2) % 3;
  const bool along_b = halved_face_edge < 6;
  const int line = halved_face_edge % 6 / 2;  // j of the row or i of the column
  if (line == 1)
    return static_cast<std::uint8_t>(kCellEdges + 4 * face + (along_b ? 2 : 0) +
                                     halved_face_edge % 2);
  int at[3] = {0, 0, 0};
  at[axis] = face % 2;
  at[along_b ? c : b] = line / 2;
  return static_cast<std::uint8_t>(edgeNumber(along_b ? b : c, at[0], at[1], at[2]));
}

inline constexpr auto kHalvedFacePoints = [] {
  std::array<std::array<std::uint8_t, kHalvedFaceEdges>, 6> points{};
  for (int face = 0; face < 6; ++face)
    for (int edge = 0; edge < kHalvedFaceEdges; ++edge)
      points[static_cast<std::size_t>(face)][static_cast<std::size_t>(edge)] =
          contourPoint(face, edge);
  return points;
}();

// The pieces on the faces of one cell.
struct Contour {
  // Six faces of at most four halves of halves with two pieces each.
  static constexpr std::size_t kMostPieces = 48;
  static constexpr std::uint8_t kNoPiece = 255;

  struct Piece {
    std::uint8_t from, to;
    std::uint8_t face;  // that it lies in, of the cell: bit f is face f
  };
  static_assert(kContourPoints <= 64);
  std::array<Piece, kMostPieces> pieces;
  std::size_t size = 0;
  std::array<std::uint8_t, kContourPoints> next;      // the piece that begins at a point
  std::array<std::uint32_t, kContourPoints> numbers;  // of the vertices of points that are known
  std::uint64_t known = 0;                            // points, a bit each

  Contour() { next.fill(kNoPiece); }
  bool isKnown(std::uint8_t point) const { return (known >> point & 1) != 0; }
  void setNumber(std::uint8_t point, std::uint32_t vertex) {
    numbers[point] = vertex;
    known |= std::uint64_t{1} << point;
  }
  void add(std::uint8_t from, std::uint8_t to, int in_face) {
    pieces[size] = {from, to, static_cast<std::uint8_t>(1u << in_face)};
    if (next[from] == kNoPiece) next[from] = static_cast<std::uint8_t>(size);
    ++size;
  }
};

// A closed loop of a contour, in the direction of the pieces.
struct ContourLoop {
  std::span<const std::uint32_t> vertices;
  // For each vertex the faces of the cell that it lies in, bit f for face f. A vertex on an edge
  // lies in two, and has a piece in each of them.
  std::span<const std::uint8_t> faces;
};

// Calls loop(ContourLoop) for every closed loop. It is valid during the call. False if pieces close
// no loop or lack a vertex: the cell and its faces disagree about values, as is possible if these
// are not finite; the caller then throws an Error.
template <typename F>
[[nodiscard]] bool forEachLoop(const Contour& contour, F&& loop) {
  std::uint64_t used = 0;
  static_assert(Contour::kMostPieces <= 64);
  std::array<std::uint32_t, Contour::kMostPieces> vertices;
  std::array<std::uint8_t, Contour::kMostPieces> faces;
  for (std::size_t start = 0; start < contour.size; ++start) {
    if ((used >> start & 1) != 0) continue;
    std::size_t length = 0, at = start;
    std::uint8_t before = 0;  // the face of the piece that ends at the vertex
    do {
      const Contour::Piece& piece = contour.pieces[at];
      used |= std::uint64_t{1} << at;
      vertices[length] = contour.numbers[piece.from];
      if (vertices[length] == kNoVertex) return false;
      faces[length++] = piece.face | before;
      before = piece.face;
      at = contour.next[piece.to];
      if (at == Contour::kNoPiece || ((used >> at & 1) != 0 && at != start)) return false;
    } while (at != start);
    faces[0] |= before;
    loop(ContourLoop{{vertices.data(), length}, {faces.data(), length}});
  }
  return true;
}

}  // namespace isobrick
