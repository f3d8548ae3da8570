// Where the isosurface cuts the faces of one cell: pieces from vertex to vertex, and the loops that
// they close (rules 9 and 10).
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "isobrick/extract/kernels/cell_topology.h"

namespace isobrick {

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
};

// Adds the contour on face `face` of a cell with the sign pattern `pattern` (bit c: corner c is
// inside).
void addPlainFace(unsigned pattern, int face, const CellVertices& vertices, Contour& contour);

// Calls loop(vertices) for every closed loop, in the direction of the pieces. The span is valid
// during the call.
template <typename F>
void forEachLoop(const Contour& contour, F&& loop) {
  std::array<bool, Contour::kMostPieces> used{};
  std::array<std::uint32_t, Contour::kMostPieces> vertices;
  for (std::size_t start = 0; start < contour.size; ++start) {
    std::size_t length = 0;
    for (std::size_t at = start; !used[at];) {
      used[at] = true;
      vertices[length++] = contour.from[at];
      for (std::size_t next = 0; next < contour.size; ++next)
        if (contour.from[next] == contour.to[at]) {
          at = next;
          break;
        }
    }
    if (length > 0) loop(std::span<const std::uint32_t>(vertices.data(), length));
  }
}

}  // namespace isobrick
