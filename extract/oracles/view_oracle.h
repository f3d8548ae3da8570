// The view oracle: as fine as a picture can show, and coarser outside of the picture.
#pragma once

#include <cstdint>
#include <vector>

#include "isobrick/extract/oracles/coverage.h"
#include "isobrick/extract/query.h"

namespace isobrick {

// A pure function of (level, cell); all members are const and thread-safe.
//
// Lengths are of the world. Let d be the diagonal of a voxel's cube, e its longest edge, and r the
// distance from the eye to a cell's centre. A cell of level l is refined if
//
//   r < a 2^l      with a = max(pixels_per_radian e / pixels + d/2, 3d/2),
//
// and not outside of the field. So the longest edge of a leaf in the field covers at most `pixels`
// pixels. The distance to the field (negative inside) is f; a cell is refined if also
//
//   f < (3 2^(l-1) - 1) d,
//
// which every cell that the field touches fulfils from level 1 on. Both are of the kind r < a 2^l +
// c with a distance that grows by at most s over a way of s, and a >= 3d/2: by the proof of rule 3
// (docs/ALGORITHM.md, section 3) touching leaves differ by at most one level, and the parent of a
// refined cell is refined. Cells count as full cubes.
class ViewOracle {
 public:
  ViewOracle(const Lattice& lattice, const GridGeometry& geometry, const ViewPoint& view);

  // The virtual cell above the root is refined; level 0 never is.
  bool refines(int level, const Index3& cell) const;
  Coverage refinedCoverage(int level, const IndexBox& cells) const;
  // Among the `count` cells from `first` on along x, bit i being first.x + i, keeps those refined.
  void keepRefined(int level, const Index3& first, std::int64_t count, std::uint64_t* bits) const;

 private:
  // The centre of the cell, in the world turned to the axes of the index.
  glm::dvec3 centerOf(int level, const Index3& cell) const;
  // The distance of a point there from the picture's field; negative inside.
  double distanceFromField(const glm::dvec3& point) const;

  int last_level_;
  glm::dvec3 spacing_;
  glm::dvec3 eye_;
  bool has_field_ = false, is_parallel_;
  glm::dvec3 direction_{0.0};
  double field_sine_ = 0, field_cosine_ = 1, field_radius_ = 0;
  // Per level.
  std::vector<double> seen_within_squared_, near_field_within_;
};

}  // namespace isobrick
