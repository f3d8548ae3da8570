// How far a point is from a triangle.
#pragma once

#include <glm/vec3.hpp>

namespace isobrick {

// The square of the distance. The triangle a, b, c may be a line or a point (Ericson, Real-Time
// Collision Detection, 2005, 5.1.5: by the region of the triangle's plane that the point lies
// over).
double squaredDistance(const glm::dvec3& point, const glm::dvec3& a, const glm::dvec3& b,
                       const glm::dvec3& c);

}  // namespace isobrick
