// The borders of half spaces and balls, in voxel indices. Both are convex.
#pragma once

#include <array>
#include <glm/mat3x3.hpp>
#include <glm/vec3.hpp>
#include <vector>

#include "isobrick/extract/surface_region.h"

namespace isobrick {

// Where a box lies.
enum class BoxSide { kInside, kOutside, kCut };

// A plane or a sphere.
class RegionWall {
 public:
  explicit RegionWall(const HalfSpace& half_space);
  explicit RegionWall(const RegionBall& ball);

  // How far inside a point lies, about in voxels; below 0 outside.
  double depth(const glm::dvec3& point) const;
  // The part of the way from `inside` to `outside` at which the depth is 0.
  double crossing(const glm::dvec3& inside, const glm::dvec3& outside) const;
  // The direction in which the depth grows, of any length.
  glm::dvec3 inward(const glm::dvec3& point) const;
  // Of the closed box with these corners. kCut is a safe answer.
  BoxSide sideOf(const glm::dvec3& lower, const glm::dvec3& upper) const;

 private:
  bool is_ball_;
  glm::dvec3 at_;           // unit normal, or centre
  double size_;             // offset, or radius
  glm::dmat3 to_units_{1};  // of a ball
  double per_voxel_ = 1;    // units in a voxel
  glm::dvec3 reach_{0.0};   // of a ball, along the axes of the voxels
};

// Those of a region.
std::vector<RegionWall> wallsOf(const SurfaceRegion& region);

}  // namespace isobrick
