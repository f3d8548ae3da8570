// How thick the inside of a surface is behind each of its vertices.
#pragma once

#include <limits>

#include "isobrick/extract/pyramid_values.h"
#include "isobrick/extract/query.h"

namespace isobrick {

// A ray goes from the vertex against its normal until it leaves the inside of the trilinear field
// of level 0; the thickness is the length of the ray inside, in world units, exact to 1/1000 of a
// voxel. Walls and gaps that are shorter than half a voxel may be missed, but for the wall that
// begins at the vertex. The border of the volume ends the inside, as a cap would. A vertex that
// lies outside, as vertices of coarser levels may, counts from where its ray comes in; NaN if it
// does not, and if the ray meets voxels without data.
//
// No mesh is needed: only the bricks that rays cross are read, and each thread holds one at a time.
class WallThickness : public VertexValues {
 public:
  // `most`: rays end after so many world units, above 0, and thicker walls have that thickness. The
  // pyramid, of the surface that the vertices are of, outlives this. Reads nothing yet.
  WallThickness(const Pyramid& pyramid, double isovalue,
                double most = std::numeric_limits<double>::infinity(),
                InsideOf inside = InsideOf::kAbove);

  // Throws Error, with the path and the brick, if samples cannot be read.
  void evaluate(std::span<const glm::dvec3> world, std::span<const glm::vec3> normals,
                std::span<double> values) const override;

 private:
  const Pyramid& pyramid_;
  const PyramidValues field_;
  const InsideOf inside_;
  double outermost_;  // value of the inside, as samples are stored
  const double most_;
};

}  // namespace isobrick
