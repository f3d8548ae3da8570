#include "isobrick/extract/oracles/focus_oracle.h"

#include <cmath>
#include <limits>

namespace isobrick {
namespace {

// The diagonal of a voxel cell, enlarged by a millionth: at the contradiction on which the proof of
// rule 3 ends, both sides can be equal, and rounding must not turn that into a pair of leaves two
// levels apart.
const double kDiagonal = std::sqrt(3.0) * (1.0 + 0x1p-20);

// Eq. 1 solved for the distance: cells of `level` closer to the focus are refined.
double refinedWithin(int level, double radius) {
  const double reach = radius + kDiagonal * (3.0 * std::ldexp(1.0, level - 1) - 1.0);
  return reach > 0 ? reach : 0.0;
}

}  // namespace

FocusOracle::FocusOracle(const Lattice& lattice, const Query& query)
    : last_level_(lattice.levels() - 1) {
  constexpr double kEverywhere = std::numeric_limits<double>::infinity();
  if (query.focus) focus_ = query.focus->center;
  refined_within_squared_.push_back(0.0);
  for (int level = 1; level <= last_level_; ++level) {
    double within = kEverywhere;
    if (query.uniform_level)
      within = level > *query.uniform_level ? kEverywhere : 0.0;
    else if (query.focus)
      within = refinedWithin(level, query.focus->radius);
    refined_within_squared_.push_back(within * within);
  }
}

Share FocusOracle::shareOfRefined(int level, const IndexBox& cells) const {
  if (level > last_level_) return Share::kAll;
  const double within = refined_within_squared_[static_cast<std::size_t>(level)];
  if (within == 0.0) return Share::kNone;
  const DistanceBounds distance = squaredDistanceBounds(focus_, level, cells);
  if (distance.greatest < within) return Share::kAll;
  if (distance.least >= within) return Share::kNone;
  return Share::kSome;
}

}  // namespace isobrick
