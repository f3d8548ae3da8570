#include "isobrick/extract/sinks/triangle_sink.h"

#include <algorithm>
#include <cmath>

namespace isobrick {

double MeshFrame::coordinateMagnitudeInVoxels() const {
  double greatest = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const glm::dvec3 world = geometry.indexToWorld(
        glm::dvec3((corner & 1) != 0 ? voxels.x - 1 : 0, (corner & 2) != 0 ? voxels.y - 1 : 0,
                   (corner & 4) != 0 ? voxels.z - 1 : 0));
    greatest = std::max({greatest, std::abs(world.x), std::abs(world.y), std::abs(world.z)});
  }
  const double spacing = std::min({geometry.spacing.x, geometry.spacing.y, geometry.spacing.z});
  return greatest / spacing;
}

}  // namespace isobrick
