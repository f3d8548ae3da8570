// Who a vertex is: the lattice edge that it lies on (rule 8).
#pragma once

#include <cstdint>

#include "isobrick/storage/grid.h"

namespace isobrick {

// Identifies a crossing among all levels: the voxel position of its edge's lower end and the axis.
//
//   bit 63 62   61 .. 42   41 .. 22   21 .. 2   1 0
//       0  0    z          y          x         axis
//
// The edge's length is not part of it: where leaves of two levels share an edge, only the coarser
// edge carries a crossing, so one (position, axis) names one edge in a mesh.
using EdgeKey = std::uint64_t;
inline constexpr EdgeKey kNoEdge = ~EdgeKey{0};

constexpr EdgeKey makeEdgeKey(const Index3& position, int axis) {
  return (static_cast<EdgeKey>(position.z) << 42) | (static_cast<EdgeKey>(position.y) << 22) |
         (static_cast<EdgeKey>(position.x) << 2) | static_cast<EdgeKey>(axis);
}
static_assert(kMaxVoxelsPerAxis <= (std::int64_t{1} << 20));

}  // namespace isobrick
