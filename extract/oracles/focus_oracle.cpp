#include "isobrick/extract/oracles/focus_oracle.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "isobrick/extract/kernels/row_bits.h"

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

FocusOracle::FocusOracle(const Lattice& lattice, const DetailChoice& choice)
    : last_level_(lattice.levels() - 1) {
  constexpr double kEverywhere = std::numeric_limits<double>::infinity();
  if (choice.focus) focus_ = choice.focus->center;
  refined_within_squared_.push_back(0.0);
  for (int level = 1; level <= last_level_; ++level) {
    double within = kEverywhere;
    if (choice.uniform_level)
      within = level > *choice.uniform_level ? kEverywhere : 0.0;
    else if (choice.focus)
      within = refinedWithin(level, choice.focus->radius);
    refined_within_squared_.push_back(within * within);
  }
}

Coverage FocusOracle::refinedCoverage(int level, const IndexBox& cells) const {
  if (level > last_level_) return Coverage::kAll;
  const double within = refined_within_squared_[static_cast<std::size_t>(level)];
  if (within == 0.0) return Coverage::kNone;
  const DistanceBounds distance = squaredDistanceBounds(focus_, level, cells);
  if (distance.greatest < within) return Coverage::kAll;
  if (distance.least >= within) return Coverage::kNone;
  return Coverage::kSome;
}

void FocusOracle::keepRefined(int level, const Index3& first, std::int64_t count,
                              std::uint64_t* bits) const {
  if (level > last_level_) return;
  // A row cuts the sphere in one piece, in rounded arithmetic too: going away from the focus no
  // term of the squared distance falls. So the search for its ends begins at their computed places.
  const double within = refined_within_squared_[static_cast<std::size_t>(level)];
  if (within == std::numeric_limits<double>::infinity()) return;
  const RowDistance distance(focus_, level, first);
  const auto isRefined = [&](std::int64_t i) { return distance.squared(i) < within; };
  const double beside = distance.squaredBesideX();
  if (beside >= within) {
    keepBits(bits, count, 0, 0);
    return;
  }
  if (isRefined(0) && isRefined(count - 1)) return;
  const double cells = 1.0 / distance.edge();  // in a voxel; exact, and faster than a division
  const double at = focus_.x * cells - 0.5 - static_cast<double>(first.x);  // of the focus
  const auto last = static_cast<double>(count - 1);
  const auto nearest = static_cast<std::int64_t>(std::clamp(at, 0.0, last) + 0.5);
  // The cell whose centre is nearest, or the one beside it if that is a tie by rounding.
  std::int64_t from = nearest;
  if (!isRefined(from)) {
    if (from + 1 < count && isRefined(from + 1))
      ++from;
    else if (from > 0 && isRefined(from - 1))
      --from;
    else {
      keepBits(bits, count, 0, 0);
      return;
    }
  }
  const double half = std::sqrt(within - beside) * cells;
  std::int64_t low = static_cast<std::int64_t>(std::clamp(at - half, 0.0, last));
  std::int64_t high = static_cast<std::int64_t>(std::clamp(at + half, 0.0, last));
  low = std::min(low, from);
  high = std::max(high, from);
  while (low < from && !isRefined(low)) ++low;
  while (low > 0 && isRefined(low - 1)) --low;
  while (high > from && !isRefined(high)) --high;
  while (high + 1 < count && isRefined(high + 1)) ++high;
  keepBits(bits, count, low, high + 1);
}

}  // namespace isobrick
