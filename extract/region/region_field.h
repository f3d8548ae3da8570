// A query's region, as the workers of the query ask for it, and the borders of its half spaces and
// balls. These are convex.
#pragma once

#include <glm/mat3x3.hpp>
#include <glm/vec3.hpp>
#include <vector>

#include "isobrick/extract/region/mask_voxels.h"
#include "isobrick/extract/surface_region.h"
#include "isobrick/storage/pyramid.h"

namespace isobrick {

// Where a box lies.
enum class BoxSide { kInside, kOutside, kCut };

// A plane or a sphere, in voxel indices.
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

// Shared by all threads, each of which has readers of its own. The region outlives it.
class RegionField {
 public:
  // Throws Error for a region that makes no sense for the volume: a number that is not finite, a
  // normal or a radius of 0, a mask of another world.
  RegionField(const SurfaceRegion& region, const Pyramid& volume);

  const SurfaceRegion& region() const { return region_; }
  const std::vector<RegionWall>& walls() const { return walls_; }
  std::vector<MaskReader> readers(const CancelFlag* cancel) const;

  // Of the closed box of these voxels. kCut is a safe answer.
  BoxSide sideOf(const Index3& lower, const Index3& upper) const;
  // True if the voxel is inside. `readers`: those of this thread.
  bool has(const Index3& voxel, std::vector<MaskReader>& readers) const;

 private:
  const SurfaceRegion& region_;
  const std::vector<RegionWall> walls_;
  std::vector<MaskVoxels> masks_;
};

// Whether all masks have the voxel.
inline bool haveAll(std::vector<MaskReader>& readers, const Index3& voxel) {
  for (MaskReader& reader : readers)
    if (!reader.has(voxel)) return false;
  return true;
}

}  // namespace isobrick
