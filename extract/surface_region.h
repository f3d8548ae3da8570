// The part of a volume to which a surface is cut: half spaces, balls, and the voxels of masks.
#pragma once

#include <glm/mat3x3.hpp>
#include <glm/vec3.hpp>
#include <memory>
#include <optional>
#include <vector>

#include "isobrick/storage/grid.h"
#include "isobrick/storage/pyramid.h"

namespace isobrick {

// The points with dot(normal, point) >= offset, as the viewer's clip planes keep them. In voxel
// indices; the normal is of any length above 0.
struct HalfSpace {
  glm::dvec3 normal{1.0, 0.0, 0.0};  // towards the points that stay
  double offset = 0;                 // see above
  bool operator==(const HalfSpace&) const = default;
};

// The points with length(to_units * (point - center)) <= radius.
struct RegionBall {
  glm::dvec3 center{0.0};    // voxel index
  double radius = 0;         // above 0
  glm::dmat3 to_units{1.0};  // from voxel indices to those of the radius: 1 for voxels
  bool operator==(const RegionBall&) const = default;
};

// The voxels at whose places in the world another volume has a value: its nearest voxel counts.
// Outside of that volume there are none.
struct RegionMask {
  std::shared_ptr<const Pyramid> pyramid;  // of the same world; level 0 is read
  std::optional<double> value;             // in the values of its input; none: all but 0
  bool operator==(const RegionMask&) const = default;
};

// What all of them have in common. Without any it is the whole volume.
//
// Without caps (Query::cap) the surface is open where the region ends. At half spaces and balls its
// triangles are cut; of masks, a vertex stays if both voxels beside it are in the mask, and a
// triangle if its three vertices stay. All that stays has the bits of the whole surface.
//
// With caps the surface is that of the object within the region, closed: marching cubes of level 0,
// with the voxels outside of the region outside of the object. A crossing lies on the half space or
// ball, if that is nearer to the inside than the isovalue, and half-way to a voxel that is not in a
// mask; all others have the places of the whole surface. Normals within a voxel of the cut are
// those of the object that was cut.
struct SurfaceRegion {
  std::vector<HalfSpace> half_spaces;  // see there
  std::vector<RegionBall> balls;       // likewise
  std::vector<RegionMask> masks;       // likewise

  bool operator==(const SurfaceRegion&) const = default;
  // True if nothing is cut.
  bool isEverywhere() const { return half_spaces.empty() && balls.empty() && masks.empty(); }
};

// A half space that is given in world units.
HalfSpace halfSpaceInWorld(const GridGeometry& geometry, const glm::dvec3& normal, double offset);
// A ball that is given in world units.
RegionBall ballInWorld(const GridGeometry& geometry, const glm::dvec3& center, double radius);

}  // namespace isobrick
