// A volume of two balls apart from each other, each a piece of the surface 0.
#pragma once

#include <algorithm>
#include <glm/geometric.hpp>
#include <memory>

#include "tests/support/field_pyramid.h"

namespace isobrick::test {

// Voxels.
inline constexpr glm::dvec3 kLarge{30, 30, 30}, kSmall{64, 64, 64};
inline constexpr double kLargeRadius = 22, kSmallRadius = 12;

// Half a unit from voxel to voxel, far from the world's origin.
inline GridGeometry twoBallsGeometry() {
  GridGeometry geometry;
  geometry.spacing = glm::dvec3(0.5);
  geometry.origin = {100, 200, -300};
  return geometry;
}

inline std::shared_ptr<const Pyramid> openTwoBalls(const TemporaryFolder& folder) {
  return openField(
      folder, Index3(81),
      [](const glm::dvec3& p) {
        return std::max(kLargeRadius - glm::distance(p, kLarge),
                        kSmallRadius - glm::distance(p, kSmall));
      },
      twoBallsGeometry());
}

}  // namespace isobrick::test
