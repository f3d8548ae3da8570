// The vertex on an edge: the arithmetic that both sides of every border share bit by bit (rules 8
// and 12).
//
// All of it is float, in operations that IEEE 754 defines to the bit (+ - * / and the square root,
// one rounding each, nothing fused), in the order written here. The vector lanes of the uniform
// kernel (brick_crossings.cpp) repeat it operation by operation.
#pragma once

#include <algorithm>
#include <cmath>
#include <glm/vec3.hpp>
#include <limits>

#include "isobrick/extract/crossing_grid.h"
#include "isobrick/extract/query.h"
#include "isobrick/storage/brick_layout.h"
#include "isobrick/storage/voxel_type.h"

namespace isobrick {

// Crossings keep this part of the edge away from its ends (rule 8).
inline constexpr float kLeastCrossing = 1.0f / 4096;

// Adding this to a number in [0, 1] leaves kCrossingBits behind the point.
inline constexpr float kCrossingRounder = 1.5f * (1 << (23 - kCrossingBits));

// False for the difference of values that are too far apart for float.
inline bool isFiniteDifference(float difference) {
  return std::abs(difference) <= std::numeric_limits<float>::max();
}

// The parts of an edge between which its crossing lies, from its lower end: multiples of
// 2^-kCrossingBits.
struct CrossingBounds {
  float least = kLeastCrossing, most = 1.0f - kLeastCrossing;
};

// Those of the part below the middle of an edge, or above it, where leaves of two levels touch: the
// finer ones have one of the parts as an edge, and the crossing must lie inside of it, not at its
// end. `middle`: in (0, 1).
inline CrossingBounds boundsBeside(double middle, bool is_above) {
  constexpr double kSteps = 1 << kCrossingBits;
  const double nearest = std::nearbyint(middle * kSteps);
  CrossingBounds bounds;
  if (is_above)
    bounds.least = std::max(bounds.least, static_cast<float>((nearest + 1) / kSteps));
  else
    bounds.most = std::min(bounds.most, static_cast<float>((nearest - 1) / kSteps));
  return bounds;
}

// The place of the crossing on an edge with the values `low` and `high` at its ends, as a part of
// the edge from its lower end. Exactly one of the values is >= isovalue. The result is within its
// bounds for any values, also for infinite, NaN or equal ones, which no sound pyramid holds.
inline float crossingParameter(float isovalue, float low, float high,
                               const CrossingBounds& bounds = {}) {
  float t = (isovalue - low) / (high - low);
  // Values such as 3.4e38 and -3.4e38: half of them differ by a finite number.
  if (!isFiniteDifference(high - low))
    t = (0.5f * isovalue - 0.5f * low) / (0.5f * high - 0.5f * low);
  t = t > bounds.least ? t : bounds.least;  // not std::clamp, which lets NaN through
  t = t < bounds.most ? t : bounds.most;
  return (t + kCrossingRounder) - kCrossingRounder;
}

// The coordinate of the crossing at `t` of an edge of `length` voxels that ends at `high`, counted
// from an origin that brickOrigin() gave. Exact, but for the edges of thin last cells: those end at
// their brick's origin, on whatever level they are, so their one rounding is the same for all.
inline float crossingCoordinate(float high, float length, float t) {
  return high - (1.0f - t) * length;
}

// The voxel that a brick's coordinates are counted from: along each axis its lower end, or the last
// voxel if it reaches that.
inline Index3 brickOrigin(const Lattice& lattice, int level, const IndexBox& cells) {
  Index3 origin;
  for (int axis = 0; axis < 3; ++axis) {
    const bool is_last = cells.end()[axis] == lattice.cells(level)[axis];
    origin[axis] = lattice.position(level, axis, is_last ? cells.end()[axis] : cells.first[axis]);
  }
  return origin;
}

// The gradient at a point of an edge, linear between its ends.
inline glm::vec3 gradientAt(const glm::vec3& low, const glm::vec3& high, float t) {
  const float s = 1.0f - t;
  return {low.x * s + high.x * t, low.y * s + high.y * t, low.z * s + high.z * t};
}

// From index space to world space for one volume: normals, which are gradients and transform with
// the inverse transpose, and the way round of triangles. Both are turned round if the inside is
// below the isovalue. Positions stay with the brick; see WorldPlacement.
class WorldFrame {
 public:
  // `values`: least and greatest voxel, so that squares of gradients neither overflow nor vanish.
  explicit WorldFrame(const GridGeometry& geometry, const ValueRange& values = {0.0f, 1.0f},
                      InsideOf inside = InsideOf::kAbove)
      : mirrored_((glm::determinant(geometry.indexToWorldMatrix()) < 0) !=
                  (inside == InsideOf::kBelow)) {
    const double side = inside == InsideOf::kBelow ? -1.0 : 1.0;
    const glm::dmat3 to_normal = side * glm::transpose(glm::inverse(geometry.indexToWorldMatrix()));
    double greatest = 0;
    for (int column = 0; column < 3; ++column)
      for (int row = 0; row < 3; ++row)
        greatest = std::max(greatest, std::abs(to_normal[column][row]));
    const double difference = static_cast<double>(values.max) - static_cast<double>(values.min);
    const int scale =
        difference > 0 ? std::min(kGradientExponent - std::ilogb(difference), kMostExponent) : 0;
    for (int column = 0; column < 3; ++column)
      for (int row = 0; row < 3; ++row)
        normal_matrix_[row][column] =
            static_cast<float>(std::ldexp(to_normal[column][row] / greatest, scale));
    for (int column = 0; column < 3; ++column)
      for (int row = 0; row < 3; ++row)
        diagonal_ = diagonal_ && (row == column || normal_matrix_[row][column] == 0);
    for (int axis = 0; axis < 3; ++axis) edge_normals_[axis] = glm::normalize(to_normal[axis]);
  }

  // The outward unit normal for an index-space gradient: towards lower values if the inside is
  // above. If the gradient vanishes, the normal is along the edge. `low_end_is_above`: the value at
  // the edge's low end is at least the isovalue.
  glm::vec3 normal(const glm::vec3& gradient, int edge_axis, bool low_end_is_above) const {
    const glm::vec3 world = transformed(gradient);
    const float square = (world.x * world.x + world.y * world.y) + world.z * world.z;
    if (!isUsable(square)) return normalInDouble(gradient, edge_axis, low_end_is_above);
    const float factor = -1.0f / std::sqrt(square);
    return {world.x * factor, world.y * factor, world.z * factor};
  }

  // Squares of transformed gradients that have all their bits and a root: neither vanishing nor
  // infinite nor NaN. If one is not, normal() computes in double.
  static constexpr float kLeastSquare = 0x1p-90f;
  static bool isUsable(float square) {
    return square >= kLeastSquare && square < std::numeric_limits<float>::infinity();
  }

  // Row by row: from a gradient to a world direction, up to a factor.
  const float* normalMatrix() const { return &normal_matrix_[0][0]; }
  // True if the world's axes are those of the index: then only the diagonal counts.
  bool isDiagonal() const { return diagonal_; }

  // True if triangles must turn round: the index axes are left-handed in the world, or the inside
  // is below the isovalue, but not both.
  bool mirrored() const { return mirrored_; }

 private:
  // Gradients become about 2^this at the most.
  static constexpr int kGradientExponent = 56;
  static constexpr int kMostExponent = 120;  // of the factor that makes them so

  glm::vec3 transformed(const glm::vec3& g) const {
    const auto& m = normal_matrix_;
    if (diagonal_) return {m[0][0] * g.x, m[1][1] * g.y, m[2][2] * g.z};
    return {(m[0][0] * g.x + m[0][1] * g.y) + m[0][2] * g.z,
            (m[1][0] * g.x + m[1][1] * g.y) + m[1][2] * g.z,
            (m[2][0] * g.x + m[2][1] * g.y) + m[2][2] * g.z};
  }

  // Gradients that are tiny against the volume's range of values: beside a voxel of 1e36 that means
  // "no value", say.
  glm::vec3 normalInDouble(const glm::dvec3& g, int edge_axis, bool low_end_is_above) const {
    glm::dvec3 world;
    for (int row = 0; row < 3; ++row) {
      const float* m = normal_matrix_[row];
      world[row] = (m[0] * g.x + m[1] * g.y) + m[2] * g.z;
    }
    const double square = (world.x * world.x + world.y * world.y) + world.z * world.z;
    if (!(square > 0) || !std::isfinite(square))
      return low_end_is_above ? edge_normals_[edge_axis] : -edge_normals_[edge_axis];
    return glm::vec3(world * (-1.0 / std::sqrt(square)));
  }

  float normal_matrix_[3][3];
  glm::vec3 edge_normals_[3];  // unit, towards rising indices if the inside is above
  bool diagonal_ = true;
  bool mirrored_;
};

}  // namespace isobrick
