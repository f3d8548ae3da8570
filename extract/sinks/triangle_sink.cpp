#include "isobrick/extract/sinks/triangle_sink.h"

#include <algorithm>
#include <cmath>

namespace isobrick {

double MeshFrame::coordinateMagnitudeInVoxels() const {
  double greatest = 0;
  for (const glm::dvec3& world : worldCorners(geometry, voxels))
    greatest = std::max({greatest, std::abs(world.x), std::abs(world.y), std::abs(world.z)});
  return greatest / geometry.leastSpacing();
}

}  // namespace isobrick
