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
  std::size_t size = 0;

  void add(std::uint32_t a, std::uint32_t b) {
    from[size] = a;
    to[size] = b;
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

// Calls loop(vertices) for every closed loop, in the direction of the pieces. The span is valid
// during the call. False where pieces close no loop or lack a vertex: values of which the cell and
// its faces do not think alike, as values that are not finite can be; the caller has an Error then.
template <typename F>
[[nodiscard]] bool forEachLoop(const Contour& contour, F&& loop) {
  std::array<bool, Contour::kMostPieces> used{};
  std::array<std::uint32_t, Contour::kMostPieces> vertices;
  for (std::size_t start = 0; start < contour.size; ++start) {
    if (used[start]) continue;
    std::size_t length = 0, at = start;
    do {
      used[at] = true;
      vertices[length++] = contour.from[at];
      at = contour.pieceFrom(contour.to[at]);
      if (at == contour.size || (used[at] && at != start)) return false;
    } while (at != start);
    loop(std::span<const std::uint32_t>(vertices.data(), length));
  }
  return true;
}

}  // namespace isobrick
