// The focus oracle: fine around a point, coarser with distance (Sect. 5.1, Eq. 1 of the paper; rule
// 3).
#pragma once

#include <limits>
#include <vector>

#include "isobrick/extract/kernels/sphere_rows.h"
#include "isobrick/extract/oracles/coverage.h"
#include "isobrick/extract/query.h"

namespace isobrick {

// A pure function of (level, cell); all members are const and thread-safe.
//
// With s = distance(cell centre, focus) - r, Eq. 1 refines a cell of level l exactly when
// 1 + log2((s + d) / 3d) < l, that is, when s < d (3 * 2^(l-1) - 1). So one squared distance is
// compared with one number a level, and no logarithm is taken. The clamped lattice does not matter
// here: cells count as full cubes, so the proof of rule 3 (touching leaves differ by at most one
// level) holds at the border too. It also gives that the parent of a refined cell is refined.
class FocusOracle {
 public:
  // Without a focus every cell down to level 0, or to the choice's uniform level, is refined.
  FocusOracle(const Lattice& lattice, const DetailChoice& choice);

  // The virtual cell above the root is refined; level 0 never is.
  bool refines(int level, const Index3& cell) const {
    if (level > last_level_) return true;
    return squaredDistance(focus_, level, cell) <
           refined_within_squared_[static_cast<std::size_t>(level)];
  }
  Coverage refinedCoverage(int level, const IndexBox& cells) const;
  // Among the `count` cells from `first` on along x, bit i being first.x + i, keeps those refined.
  void keepRefined(int level, const Index3& first, std::int64_t count, std::uint64_t* bits) const;
  // The same cells of the row as one run, and for `rows` rows at once, at most SphereRows::kMost,
  // that follow each other along y.
  CellSpan refinedSpan(int level, const Index3& first, std::int64_t count) const;
  void refinedSpans(int level, const Index3& first, std::int64_t count, std::size_t rows,
                    CellSpan* out) const;

 private:
  static constexpr double kEverywhere = std::numeric_limits<double>::infinity();

  bool refinesAll(int level) const {
    return level > last_level_ ||
           refined_within_squared_[static_cast<std::size_t>(level)] == kEverywhere;
  }

  int last_level_;
  glm::dvec3 focus_{0.0};
  std::vector<double> refined_within_squared_;  // per level
};

}  // namespace isobrick
