// The curvature oracle: flat pieces of the surface may be coarse (Sect. 5.2, Eq. 2; rule 4).
#pragma once

#include <cstdint>
#include <limits>
#include <unordered_map>
#include <vector>

#include "isobrick/extract/oracles/cell_distance.h"
#include "isobrick/extract/oracles/coverage.h"
#include "isobrick/extract/session/mesh_context.h"

namespace isobrick {

// Refines every cell but those of level 1 whose centre lies within the sphere of interest and whose
// curvature bound is within the choice's tolerance; without a tolerance every cell.
//
// Keeps the curvature of the bricks that it read, so one object serves one thread for one brick.
class CurvatureOracle {
 public:
  CurvatureOracle(const MeshContext& context, const DetailChoice& choice);

  bool refines(int level, const Index3& cell) {
    return level != 1 || !is_on_ || squaredDistance(center_, 1, cell) > radius_squared_ ||
           !isFlat(cell);
  }
  // Among the `count` cells from `first` on along x, bit i being first.x + i, keeps those refined.
  void keepRefined(int level, const Index3& first, std::int64_t count, std::uint64_t* bits);
  Coverage refinedCoverage(int level, const IndexBox& cells) const {
    if (level != 1 || !is_on_) return Coverage::kAll;
    return squaredDistanceBounds(center_, 1, cells).least <= radius_squared_ ? Coverage::kSome
                                                                             : Coverage::kAll;
  }

 private:
  struct BrickCurvature {
    std::vector<std::uint8_t> coefficients;
    std::vector<ValueRange> tile_ranges;
  };

  // True if the curvature bound of the cell of level 1 is within the tolerance. If the isovalue is
  // outside the tile's range, the bound at the range's end decides: cells beside a flat piece of
  // the surface are coarse with it, and no transition is needed between them.
  bool isFlat(const Index3& cell);
  const BrickCurvature& curvatureOf(const Index3& brick);

  const MeshContext* context_;
  bool is_on_;
  double tolerance_;
  glm::dvec3 center_{0.0};
  double radius_squared_ = std::numeric_limits<double>::infinity();
  std::unordered_map<std::size_t, BrickCurvature> bricks_;  // by row of the brick table
  std::size_t last_row_ = 0;                                // used last, if any was
  const BrickCurvature* last_ = nullptr;
};

}  // namespace isobrick
