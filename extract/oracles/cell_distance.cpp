#include "isobrick/extract/oracles/cell_distance.h"

#include <algorithm>

namespace isobrick {

DistanceBounds squaredDistanceBounds(const glm::dvec3& point, int level, const IndexBox& cells) {
  const double edge = static_cast<double>(std::int64_t{1} << level);
  DistanceBounds bounds;
  for (int axis = 0; axis < 3; ++axis) {
    const double low = (static_cast<double>(cells.first[axis]) + 0.5) * edge - point[axis];
    const double high = (static_cast<double>(cells.end()[axis]) - 0.5) * edge - point[axis];
    // No branches: which side the point is on changes from call to call.
    const double near = std::max(std::max(low, -high), 0.0);
    const double far = std::max(-low, high);
    bounds.least += near * near;
    bounds.greatest += far * far;
  }
  bounds.least *= 1 - 1e-6;
  bounds.greatest *= 1 + 1e-6;
  return bounds;
}

}  // namespace isobrick
