// Where the isosurface cuts the faces of one cell: pieces from vertex to vertex, and the loops that
// they close (rules 9 and 10).
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "isobrick/extract/kernels/cell_topology.h"

namespace isobrick {

// The number of a vertex that does not exist. In a sound pyramid every crossing that is asked for
// has its vertex; where ranges hide samples, or values are not finite, kernels find this instead.
inline constexpr std::uint32_t kNoVertex = ~std::uint32_t{0};

// The numbers of the vertices on a cell's edges; only crossed edges have one.
using CellVertices = std::array<std::uint32_t, kCellEdges>;

struct Contour {
  // Six faces of at most four sub-faces with two pieces each.
  static constexpr std::size_t kMostPieces = 48;

  std::array<std::uint32_t, kMostPieces> from;
  std::array<std::uint32_t, kMostPieces> to;
  std::array<std::uint8_t, kMostPieces> face;  // that it lies in, of the cell: bit f is face f
  std::size_t size = 0;

  void add(std::uint32_t a, std::uint32_t b, int in_face) {
    from[size] = a;
    to[size] = b;
    face[size] = static_cast<std::uint8_t>(1u << in_face);
    ++size;
  }
  // The piece that begins at `vertex`; `size` where there is none.
  std::size_t pieceFrom(std::uint32_t vertex) const {
    std::size_t piece = 0;
    while (piece < size && (vertex == kNoVertex || from[piece] != vertex)) ++piece;
    return piece;
  }
};

// Adds the contour on face `face` of a cell with the sign pattern `pattern` (bit c: corner c is
// inside).
void addPlainFace(unsigned pattern, int face, const CellVertices& vertices, Contour& contour);

// A closed loop of a contour, in the direction of the pieces.
struct ContourLoop {
  std::span<const std::uint32_t> vertices;
  // Of each vertex: the faces of the cell that it lies in, bit f for face f. One of an edge lies in
  // two, and has a piece in each of them.
  std::span<const std::uint8_t> faces;
};

// Calls loop(ContourLoop) for every closed loop. It is valid during the call. False where pieces
// close no loop or lack a vertex: values of which the cell and its faces do not think alike, as
// values that are not finite can be; the caller has an Error then.
template <typename F>
[[nodiscard]] bool forEachLoop(const Contour& contour, F&& loop) {
  std::array<bool, Contour::kMostPieces> used{};
  std::array<std::uint32_t, Contour::kMostPieces> vertices;
  std::array<std::uint8_t, Contour::kMostPieces> faces;
  for (std::size_t start = 0; start < contour.size; ++start) {
    if (used[start]) continue;
    std::size_t length = 0, at = start;
    std::uint8_t before = 0;  // the face of the piece that ends at the vertex
    do {
      used[at] = true;
      vertices[length] = contour.from[at];
      faces[length++] = contour.face[at] | before;
      before = contour.face[at];
      at = contour.pieceFrom(contour.to[at]);
      if (at == contour.size || (used[at] && at != start)) return false;
    } while (at != start);
    faces[0] |= before;
    loop(ContourLoop{{vertices.data(), length}, {faces.data(), length}});
  }
  return true;
}

}  // namespace isobrick
