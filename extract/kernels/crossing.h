// The vertex on an edge: the arithmetic that both sides of every border share bit by bit (rules 8
// and 12).
#pragma once

#include <algorithm>
#include <cmath>

#include "isobrick/storage/grid.h"

namespace isobrick {

// Crossings keep this part of the edge away from its ends (rule 8).
inline constexpr double kLeastCrossing = 1.0 / 4096;

// Where the isosurface crosses an edge with the values `low` and `high` at its ends, as a part of
// the edge from its lower end. Exactly one of the values is >= isovalue. Within its bounds for any
// values, also those that no sound pyramid holds: infinite, NaN, or equal.
inline double crossingParameter(float isovalue, float low, float high) {
  const double t = (static_cast<double>(isovalue) - static_cast<double>(low)) /
                   (static_cast<double>(high) - static_cast<double>(low));
  // Not std::clamp, which lets NaN through.
  return t > kLeastCrossing ? std::min(t, 1.0 - kLeastCrossing) : kLeastCrossing;
}

// From index space to world space for one volume. Points keep double precision; normals are
// gradients and transform with the inverse transpose.
class WorldFrame {
 public:
  explicit WorldFrame(const GridGeometry& geometry)
      : origin_(geometry.origin),
        matrix_(geometry.indexToWorldMatrix()),
        normal_matrix_(glm::transpose(glm::inverse(matrix_))),
        mirrored_(glm::determinant(matrix_) < 0) {}

  glm::dvec3 position(const glm::dvec3& index) const { return origin_ + matrix_ * index; }

  // The unit normal towards lower values for an index-space gradient. Where the gradient vanishes
  // the edge itself knows the way: from its inside end to its outside end.
  glm::vec3 normal(const glm::dvec3& gradient, int edge_axis, bool low_end_is_inside) const {
    const glm::dvec3 world = normal_matrix_ * gradient;
    const double length = std::sqrt(world.x * world.x + world.y * world.y + world.z * world.z);
    if (length > 0 && std::isfinite(length)) return glm::vec3(world * (-1.0 / length));
    glm::dvec3 along{0.0};
    along[edge_axis] = low_end_is_inside ? 1.0 : -1.0;
    const glm::dvec3 direction = normal_matrix_ * along;
    return glm::vec3(direction / std::sqrt(glm::dot(direction, direction)));
  }

  // True where the index axes are left-handed in the world, so that triangles must turn round.
  bool mirrored() const { return mirrored_; }

 private:
  glm::dvec3 origin_;
  glm::dmat3 matrix_;
  glm::dmat3 normal_matrix_;
  bool mirrored_;
};

// The gradient at a point of an edge, linear between its ends.
inline glm::dvec3 gradientAt(const glm::dvec3& low, const glm::dvec3& high, double t) {
  return (1.0 - t) * low + t * high;
}

}  // namespace isobrick
