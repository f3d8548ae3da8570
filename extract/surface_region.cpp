#include "isobrick/extract/surface_region.h"

#include <glm/geometric.hpp>
#include <glm/matrix.hpp>

namespace isobrick {

HalfSpace halfSpaceInWorld(const GridGeometry& geometry, const glm::dvec3& normal, double offset) {
  return {glm::transpose(geometry.indexToWorldMatrix()) * normal,
          offset - glm::dot(normal, geometry.origin)};
}

RegionBall ballInWorld(const GridGeometry& geometry, const glm::dvec3& center, double radius) {
  return {geometry.worldToIndex(center), radius, geometry.indexToWorldMatrix()};
}

}  // namespace isobrick
