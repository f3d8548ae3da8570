#include "extract/oracles/refinement_oracle.h"

#include <cmath>
#include <limits>
#include <utility>

namespace isobrick {
namespace {

// The diagonal of a voxel cell, enlarged by a millionth: at the contradiction on which the proof of
// rule 3 ends, both sides can be equal, and rounding must not turn that into a pair of leaves two
// levels apart.
const double kDiagonal = std::sqrt(3.0) * (1.0 + 0x1p-20);

}  // namespace

RefinementOracle::RefinementOracle(const Lattice& lattice, const Query& query)
    : last_level_(lattice.levels() - 1) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const double radius = query.focus ? query.focus->radius : kInfinity;
  if (query.focus) focus_ = query.focus->center;
  sphere_squared_ = radius * radius;
  refined_within_squared_.assign(static_cast<std::size_t>(lattice.levels()), 0.0);
  for (int level = 1; level <= last_level_; ++level) {
    double& within = refined_within_squared_[static_cast<std::size_t>(level)];
    if (query.uniform_level) {
      within = level > *query.uniform_level ? kInfinity : 0.0;
    } else {
      const double reach = radius + kDiagonal * (3.0 * std::ldexp(1.0, level - 1) - 1.0);
      within = reach > 0 ? reach * reach : 0.0;
    }
  }
}

std::pair<double, double> RefinementOracle::distanceBounds(int level, const IndexBox& cells) const {
  const double edge = static_cast<double>(std::int64_t{1} << level);
  double least = 0, greatest = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const double low = (static_cast<double>(cells.first[axis]) + 0.5) * edge - focus_[axis];
    const double high = (static_cast<double>(cells.end()[axis]) - 0.5) * edge - focus_[axis];
    const double near = low > 0 ? low : high < 0 ? high : 0.0;
    const double far = std::max(std::abs(low), std::abs(high));
    least += near * near;
    greatest += far * far;
  }
  return {least, greatest};
}

RefinementOracle::Share RefinementOracle::shareOfRefined(int level, const IndexBox& cells) const {
  if (level > last_level_) return Share::kAll;
  const double within = refined_within_squared_[static_cast<std::size_t>(level)];
  const auto [least, greatest] = distanceBounds(level, cells);
  // The bounds are rounded in their own way; a millionth of slack keeps "certain" certain.
  if (greatest * (1 + 1e-6) < within) return Share::kAll;
  if (within == 0.0 || least * (1 - 1e-6) >= within) return Share::kNone;
  return Share::kSome;
}

bool RefinementOracle::curvatureMayApply(const IndexBox& cells) const {
  return distanceBounds(1, cells).first * (1 - 1e-6) <= sphere_squared_;
}

}  // namespace isobrick
