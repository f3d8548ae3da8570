#include "isobrick/extract/oracles/focus_oracle.h"

#include <algorithm>
#include <cmath>

#include "isobrick/extract/kernels/row_bits.h"

namespace isobrick {

FocusOracle::FocusOracle(const Lattice& lattice, const DetailChoice& choice)
    : last_level_(lattice.levels() - 1) {
  if (choice.focus) focus_ = choice.focus->center;
  const double diagonal = std::sqrt(3.0) * kDiagonalRoom;
  refined_within_squared_.push_back(0.0);
  for (int level = 1; level <= last_level_; ++level) {
    double within = kEverywhere;
    if (choice.uniform_level)
      within = level > *choice.uniform_level ? kEverywhere : 0.0;
    else if (choice.focus)
      within = std::max(choice.focus->radius + refinedWithin(level, diagonal), 0.0);
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
  const CellSpan refined = refinedSpan(level, first, count);
  keepBits(bits, count, refined.begin, refined.end);
}

CellSpan FocusOracle::refinedSpan(int level, const Index3& first, std::int64_t count) const {
  if (refinesAll(level)) return {0, count};
  // A row cuts the sphere in one piece, in rounded arithmetic too: going away from the focus no
  // term of the squared distance falls. So the search for its ends begins at their computed places,
  // which are less than a cell away unless the sphere is too large for that.
  const double within = refined_within_squared_[static_cast<std::size_t>(level)];
  const RowDistance distance(focus_, level, first);
  const auto isRefined = [&](std::int64_t i) { return distance.squared(i) < within; };
  const double beside = distance.squaredBesideX();
  if (beside >= within) return {0, 0};
  constexpr double kMostReach = 0x1p20;        // in cells
  const double cells = 1.0 / distance.edge();  // in a voxel
  CellSpan span{0, count - 1};
  if (within * (cells * cells) <= kMostReach * kMostReach) {
    const double at = focus_.x * cells - 0.5 - static_cast<double>(first.x);  // of the focus
    const double half = std::sqrt(within - beside) * cells;
    const auto last = static_cast<double>(count - 1);
    span = {static_cast<std::int64_t>(std::clamp(at - half, 0.0, last)),
            static_cast<std::int64_t>(std::clamp(at + half, 0.0, last))};
  }
  // Most often this is it: the cells in which the sphere ends belong to it or not.
  span.begin += isRefined(span.begin) ? 0 : 1;
  span.end += isRefined(span.end) ? 1 : 0;
  while (span.begin > 0 && isRefined(span.begin - 1)) --span.begin;
  while (span.end < count && isRefined(span.end)) ++span.end;
  while (span.begin < span.end && !isRefined(span.begin)) ++span.begin;
  while (span.begin < span.end && !isRefined(span.end - 1)) --span.end;
  return span;
}

void FocusOracle::refinedSpans(int level, const Index3& first, std::int64_t count, std::size_t rows,
                               CellSpan* out) const {
  if (refinesAll(level)) {
    std::fill(out, out + rows, CellSpan{0, count});
    return;
  }
  SphereRows cut;
  cut.center = focus_;
  cut.within_squared = refined_within_squared_[static_cast<std::size_t>(level)];
  cut.edge = static_cast<double>(std::int64_t{1} << level);
  cut.first = first;
  cut.count = count;
  cut.cut();
  for (std::size_t row = 0; row < rows; ++row)
    out[row] = cut.is_certain[row] != 0 ? cut.span(row)
                                        : refinedSpan(level, first + Index3(0, row, 0), count);
}

}  // namespace isobrick
