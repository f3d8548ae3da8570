// The curvature oracle: flat pieces of the surface may be coarse (Sect. 5.2, Eq. 2; rule 4).
#pragma once

#include <cstdint>
#include <limits>

#include "isobrick/extract/oracles/coverage.h"
#include "isobrick/extract/oracles/flat_blocks.h"
#include "isobrick/extract/session/mesh_context.h"

namespace isobrick {

// Whether an oracle may read parts of bricks, when a brick is meshed, or may not, in a plan.
enum class BrickReads { kNone, kAllowed };

// Refines every cell but those of level 1 whose centre lies within the sphere of interest, in a
// block of which level 1 is as near to level 0 as the choice's tolerance wants it; without a
// tolerance every cell. One object serves one thread.
class CurvatureOracle {
 public:
  // `flat` is null without a tolerance.
  CurvatureOracle(const MeshContext& context, const DetailChoice& choice, FlatBlocks* flat,
                  BrickReads reads);

  bool refines(int level, const Index3& cell) const {
    return level != 1 || flat_ == nullptr || squaredDistance(center_, 1, cell) > radius_squared_ ||
           !isFlat(cell >> cells_shift_);
  }
  // Among the `count` cells from `first` on along x, bit i being first.x + i, keeps those refined.
  void keepRefined(int level, const Index3& first, std::int64_t count, std::uint64_t* bits) const;
  // Without reads, and in a progressive query, which reads what is resident alone, it is certain of
  // boxes outside the sphere alone.
  Coverage refinedCoverage(int level, const IndexBox& cells) const;

 private:
  // Of a block among all of the volume. If the isovalue is outside its range, the bound at the
  // range's end decides: cells beside a flat piece of the surface are coarse with it, and no
  // transition is needed between them.
  bool isFlat(const Index3& block) const;
  const FlatRows& rowsOf(const Index3& brick) const;

  const MeshContext* context_;
  FlatBlocks* flat_;
  bool may_read_;
  glm::dvec3 center_{0.0};
  double radius_squared_ = std::numeric_limits<double>::infinity();
  std::int64_t cells_shift_, blocks_shift_;  // cells of level 1 of a block, blocks of a brick
  mutable Index3 last_brick_{-1};            // used last
  mutable const FlatRows* last_ = nullptr;
};

}  // namespace isobrick
