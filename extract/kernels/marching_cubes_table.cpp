#include "isobrick/extract/kernels/marching_cubes_table.h"

#include <stdexcept>
#include <vector>

#include "isobrick/extract/kernels/contour.h"

namespace isobrick {
namespace {

using Loop = std::vector<int>;  // edges of the cell, in the direction of the contour

bool liesOnFace(int edge, int face) {
  const CellEdge& e = kCellEdgeTable[static_cast<std::size_t>(edge)];
  const int axis = face / 2, side = face % 2;
  const int offset = axis == 0 ? e.x : axis == 1 ? e.y : e.z;
  return e.axis != axis && offset == side;
}

bool shareFace(int a, int b) {
  for (int face = 0; face < 6; ++face)
    if (liesOnFace(a, face) && liesOnFace(b, face)) return true;
  return false;
}

// The closed contours of a pattern.
std::vector<Loop> traceLoops(unsigned pattern) {
  std::array<int, kCellEdges> next;
  next.fill(-1);
  for (int face = 0; face < 6; ++face) {
    const FaceContour contour = makePlainFace(face, pattern);
    for (std::size_t n = 0; n < contour.size; ++n)
      next[contour.pieces[n].from] = contour.pieces[n].to;
  }
  std::vector<Loop> loops;
  for (int start = 0; start < kCellEdges; ++start) {
    Loop loop;
    for (int e = start; next[static_cast<std::size_t>(e)] >= 0;) {
      loop.push_back(e);
      const int after = next[static_cast<std::size_t>(e)];
      next[static_cast<std::size_t>(e)] = -1;
      e = after;
    }
    if (!loop.empty()) loops.push_back(loop);
  }
  return loops;
}

// With the first tips that leave no side in a face, the triangles of these patterns cross each
// other for some places of the crossings, and with the last ones they do not; those of the others
// never cross. marching_cubes_table_test.cpp proves it.
constexpr bool takesLastTips(unsigned pattern) {
  return pattern == 0b11100101 || pattern == 0b11100110;
}

// Triangulates loop[first .. last] against the side (first, last): the first choice of a tip, in
// order or from the last one on, that leaves no side inside a cell face.
bool triangulate(const Loop& loop, std::size_t first, std::size_t last, bool last_tips,
                 std::vector<int>& out) {
  if (last - first < 2) return true;
  const auto sideIsAllowed = [&](std::size_t a, std::size_t b) {
    return b - a == 1 || !shareFace(loop[a], loop[b]);
  };
  for (std::size_t n = first + 1; n < last; ++n) {
    const std::size_t tip = last_tips ? first + last - n : n;
    if (!sideIsAllowed(first, tip) || !sideIsAllowed(tip, last)) continue;
    const std::size_t mark = out.size();
    out.insert(out.end(), {loop[first], loop[tip], loop[last]});
    if (triangulate(loop, first, tip, last_tips, out) &&
        triangulate(loop, tip, last, last_tips, out))
      return true;
    out.resize(mark);
  }
  return false;
}

MarchingCubesCase makeCase(unsigned pattern) {
  MarchingCubesCase result;
  std::vector<int> edges;
  for (const Loop& loop : traceLoops(pattern)) {
    // The closing side of the loop is part of the contour, so it needs no check.
    if (!triangulate(loop, 0, loop.size() - 1, takesLastTips(pattern), edges))
      throw std::logic_error("marching cubes: a loop has no triangulation off the cell's faces");
  }
  result.triangle_count = static_cast<std::uint8_t>(edges.size() / 3);
  for (std::size_t i = 0; i < edges.size(); ++i)
    result.edges.at(i) = static_cast<std::uint8_t>(edges[i]);
  return result;
}

}  // namespace

const std::array<MarchingCubesCase, 256>& marchingCubesTable() {
  static const std::array<MarchingCubesCase, 256> table = [] {
    std::array<MarchingCubesCase, 256> cases;
    for (unsigned pattern = 0; pattern < 256; ++pattern) cases[pattern] = makeCase(pattern);
    return cases;
  }();
  return table;
}

}  // namespace isobrick
