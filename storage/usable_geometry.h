// The placements of a volume in the world that computations can use.
#pragma once

#include <cmath>

#include "isobrick/storage/grid.h"

namespace isobrick {

// True if every point of a volume of up to kMaxVoxelsPerAxis voxels an axis gets a position that is
// finite, in single precision too, and world and index space can be changed into each other:
// spacings within 2^-100 .. 2^100, an origin within 2^100, directions that span space.
inline bool isUsableGeometry(const GridGeometry& geometry) {
  constexpr double kMost = 0x1p100;
  bool usable = std::abs(glm::determinant(geometry.direction)) > 1e-6;
  for (int axis = 0; axis < 3; ++axis) {
    usable = usable && geometry.spacing[axis] >= 1 / kMost && geometry.spacing[axis] <= kMost &&
             std::abs(geometry.origin[axis]) <= kMost;
    for (int row = 0; row < 3; ++row)
      usable = usable && std::abs(geometry.direction[axis][row]) <= 2;
  }
  return usable;
}

}  // namespace isobrick
