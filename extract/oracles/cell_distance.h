// How far cells are from a point.
#pragma once

#include "isobrick/storage/brick_layout.h"

namespace isobrick {

// The squared distance of a cell's centre from `point`, in voxels. Cells count as full cubes, also
// where the border makes them thin.
inline double squaredDistance(const glm::dvec3& point, int level, const Index3& cell) {
  const double edge = static_cast<double>(std::int64_t{1} << level);
  const double dx = (static_cast<double>(cell.x) + 0.5) * edge - point.x;
  const double dy = (static_cast<double>(cell.y) + 0.5) * edge - point.y;
  const double dz = (static_cast<double>(cell.z) + 0.5) * edge - point.z;
  return dx * dx + dy * dy + dz * dz;
}

// Bounds of that distance for all cells of a box. They are rounded in their own way, so they are
// drawn apart by a millionth: what lies beyond a bound does so for certain.
struct DistanceBounds {
  double least = 0;
  double greatest = 0;
};
DistanceBounds squaredDistanceBounds(const glm::dvec3& point, int level, const IndexBox& cells);

}  // namespace isobrick
