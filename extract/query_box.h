// Boxes of the world as boxes of a query.
#pragma once

#include <glm/common.hpp>
#include <limits>

#include "isobrick/extract/query.h"
#include "isobrick/storage/grid.h"

namespace isobrick {

// The least box of voxel indices around a box of world coordinates: on an oblique volume it reaches
// further than the box itself.
inline QueryBox indexBoxAround(const QueryBox& world, const GridGeometry& geometry) {
  QueryBox result{glm::dvec3(std::numeric_limits<double>::infinity()),
                  glm::dvec3(-std::numeric_limits<double>::infinity())};
  for (int corner = 0; corner < 8; ++corner) {
    glm::dvec3 at;
    for (int axis = 0; axis < 3; ++axis)
      at[axis] = (corner >> axis & 1) != 0 ? world.max[axis] : world.min[axis];
    const glm::dvec3 index = geometry.worldToIndex(at);
    result.min = glm::min(result.min, index);
    result.max = glm::max(result.max, index);
  }
  return result;
}

}  // namespace isobrick
