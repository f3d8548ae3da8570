#include "isobrick/extract/meshing/leaf_edges.h"

#include <algorithm>

#include "isobrick/extract/meshing/corner_values.h"

namespace isobrick {
namespace {

bool isOnBorder(const IndexBox& brick, int axis, std::int64_t i) {
  return i == brick.first[axis] || i == brick.first[axis] + brick.count[axis];
}

}  // namespace

LeafEdge leafEdge(const Lattice& lattice, const LeafRows& leaves, const IndexBox& brick,
                  const Index3& base, int axis) {
  const int b = (axis + 1) % 3, c = (axis + 2) % 3;
  LeafEdge edge{axis, base, base, false, false};
  ++edge.high[axis];
  edge.is_shared = isOnBorder(brick, b, base[b]) || isOnBorder(brick, c, base[c]);
  if (leaves.areLeavesAround(base, axis)) return edge;
  edge.is_shared = true;
  if (isOnCoarserLattice(lattice, leaves.level(), b, base[b]) &&
      isOnCoarserLattice(lattice, leaves.level(), c, base[c]) &&
      leaves.isAnyCoarserAround(base, axis)) {
    edge.is_of_coarser = true;
    edge.low[axis] = base[axis] / 2 * 2;
    edge.high[axis] = std::min(edge.low[axis] + 2, lattice.samples(leaves.level())[axis] - 1);
  }
  return edge;
}

}  // namespace isobrick
