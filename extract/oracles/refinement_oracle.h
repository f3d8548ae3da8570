// The focus oracle: which cells of the octree are refined (Sect. 5.1, Eq. 1 of the paper; rule 3).
#pragma once

#include <vector>

#include "extract/query.h"
#include "storage/brick_layout.h"

namespace isobrick {

// The smallest box of cells of the next coarser level that covers `cells`, which are not negative.
inline IndexBox parentsOf(const IndexBox& cells) {
  const Index3 first = cells.first / std::int64_t{2};
  const Index3 last = (cells.end() - Index3(1)) / std::int64_t{2};
  return {first, last - first + Index3(1)};
}

// A pure function of (level, cell); all members are const and thread-safe.
//
// With s = distance(cell centre, focus) - r, Eq. 1 refines a cell of level l exactly when
// 1 + log2((s + d) / 3d) < l, that is, when s < d (3 * 2^(l-1) - 1). So one squared distance is
// compared with one number a level, and no logarithm is taken. The clamped lattice does not matter
// here: cells count as full cubes, so the proof of rule 3 (touching leaves differ by at most one
// level) holds at the border too. It also gives that the parent of a refined cell is refined, so
// whether a cell is a leaf can be asked without walking down to it.
class RefinementOracle {
 public:
  RefinementOracle(const Lattice& lattice, const Query& query);

  enum class Share { kNone, kSome, kAll };

  // True where the focus (or the uniform level) refines the cell. The virtual cell above the root
  // is refined; level 0 never is.
  bool refines(int level, const Index3& cell) const {
    if (level > last_level_) return true;
    return squaredDistance(level, cell) < refined_within_squared_[static_cast<std::size_t>(level)];
  }
  // The share of refined cells in a box of cells of `level`. kNone and kAll are certain, kSome may
  // also be said of a box that is all of one kind.
  Share shareOfRefined(int level, const IndexBox& cells) const;

  // True where the curvature oracle has a say on a cell of level 1: its centre lies inside the
  // sphere of interest (Sect. 5.2).
  bool curvatureApplies(const Index3& cell) const {
    return squaredDistance(1, cell) <= sphere_squared_;
  }
  // False where curvatureApplies() is false for every cell of level 1 in the box.
  bool curvatureMayApply(const IndexBox& cells) const;

 private:
  double squaredDistance(int level, const Index3& cell) const {
    const double edge = static_cast<double>(std::int64_t{1} << level);
    const double dx = (static_cast<double>(cell.x) + 0.5) * edge - focus_.x;
    const double dy = (static_cast<double>(cell.y) + 0.5) * edge - focus_.y;
    const double dz = (static_cast<double>(cell.z) + 0.5) * edge - focus_.z;
    return dx * dx + dy * dy + dz * dz;
  }
  // Least and greatest squared distance of the cells' centres from the focus.
  std::pair<double, double> distanceBounds(int level, const IndexBox& cells) const;

  int last_level_;
  glm::dvec3 focus_{0.0};
  double sphere_squared_ = 0;
  std::vector<double> refined_within_squared_;  // per level
};

}  // namespace isobrick
