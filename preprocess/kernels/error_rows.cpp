#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "isobrick/preprocess/kernels/error_rows.cpp"
#include "isobrick/preprocess/kernels/error_rows.h"

#include <hwy/foreach_target.h>  // must come before highway.h
#include <hwy/highway.h>

#include <algorithm>
#include <limits>

#include "isobrick/storage/error_bins.h"

HWY_BEFORE_NAMESPACE();
namespace isobrick {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using Tag = hn::CappedTag<float, kErrorRun>;
using Floats = hn::Vec<Tag>;
using Mask = hn::Mask<Tag>;

HWY_INLINE std::int64_t laneCount() { return static_cast<std::int64_t>(hn::Lanes(Tag())); }

HWY_INLINE Floats between(Floats from, Floats to, Floats share) {
  return hn::Add(from, hn::Mul(share, hn::Sub(to, from)));
}

void interpolateRowHere(const float* from, const float* to, float share, std::int64_t count,
                        float* out) {
  const Tag d;
  const Floats shares = hn::Set(d, share);
  for (std::int64_t i = 0; i < count; i += laneCount())
    hn::StoreU(between(hn::LoadU(d, from + i), hn::LoadU(d, to + i), shares), d, out + i);
}

// The bins of values between two, given a bin to begin with.
HWY_INLINE BinRun binsBetween(float least, float greatest, const IsovalueBins& bins,
                              std::int64_t near) {
  std::int64_t first = near;
  while (first > 0 && least < bins.ends[first]) --first;
  while (first + 1 < bins.count && least >= bins.ends[first + 1]) ++first;
  std::int64_t last = first;
  while (last + 1 < bins.count && greatest >= bins.ends[last + 1]) ++last;
  return {static_cast<std::uint16_t>(first), static_cast<std::uint16_t>(last)};
}

void boundRowHere(const RowBetween& row, const float* value, std::int64_t count,
                  const IsovalueBins& bins, float* low, float* high, BinRun* runs) {
  const Tag d;
  const std::int64_t lanes = laneCount();
  const Floats share = hn::Set(d, row.share), slack = hn::Set(d, row.slack);
  BinRun run = {0, 0};
  // From the last run to the first, as each takes in the first voxel of the next one.
  float next_least = std::numeric_limits<float>::infinity(), next_greatest = -next_least;
  for (std::int64_t begin = (count - 1) / kErrorRun * kErrorRun; begin >= 0; begin -= kErrorRun) {
    Floats run_least = hn::Set(d, next_least), run_greatest = hn::Set(d, next_greatest);
    for (std::int64_t i = begin; i < begin + kErrorRun && i < count; i += lanes) {
      const Floats own = hn::LoadU(d, value + i);
      Floats least = between(hn::LoadU(d, row.from_low + i), hn::LoadU(d, row.to_low + i), share);
      Floats greatest =
          between(hn::LoadU(d, row.from_high + i), hn::LoadU(d, row.to_high + i), share);
      if (row.is_between != nullptr) {
        const Mask is_between = hn::Ne(hn::LoadU(d, row.is_between + i), hn::Zero(d));
        least = hn::IfThenElse(is_between, hn::Min(own, least), own);
        greatest = hn::IfThenElse(is_between, hn::Max(own, greatest), own);
      }
      least = hn::Sub(least, slack);
      greatest = hn::Add(greatest, slack);
      hn::StoreU(least, d, low + i);
      hn::StoreU(greatest, d, high + i);
      least = hn::Min(own, least);
      greatest = hn::Max(own, greatest);
      if (i + lanes > count) {
        const Mask is_voxel = hn::FirstN(d, static_cast<std::size_t>(count - i));
        least = hn::IfThenElse(is_voxel, least, hn::Set(d, hn::GetLane(least)));
        greatest = hn::IfThenElse(is_voxel, greatest, hn::Set(d, hn::GetLane(greatest)));
      }
      if (i == begin) {
        next_least = hn::GetLane(least);
        next_greatest = hn::GetLane(greatest);
      }
      run_least = hn::Min(run_least, least);
      run_greatest = hn::Max(run_greatest, greatest);
    }
    // Mostly the bin of the run behind.
    const Mask is_outside = hn::Or(hn::Lt(run_least, hn::Set(d, bins.ends[run.first])),
                                   hn::Ge(run_greatest, hn::Set(d, bins.ends[run.first + 1])));
    run.last = run.first;
    if (!hn::AllFalse(d, is_outside))
      run = binsBetween(hn::GetLane(hn::MinOfLanes(d, run_least)),
                        hn::GetLane(hn::MaxOfLanes(d, run_greatest)), bins, run.first);
    runs[begin / kErrorRun] = run;
  }
  // What lies behind the row looks like its last voxel.
  std::fill_n(low + count, kErrorRun, low[count - 1]);
  std::fill_n(high + count, kErrorRun, high[count - 1]);
}

// Voxels with the bounds of the coarse field, and how far these are from the values.
struct Bracketed {
  Floats value, low, high, above_low, below_high;
};

HWY_INLINE Bracketed load(const BracketedRow& row, std::int64_t i) {
  const Tag d;
  Bracketed voxels;
  voxels.value = hn::LoadU(d, row.value + i);
  voxels.low = hn::LoadU(d, row.low + i);
  voxels.high = hn::LoadU(d, row.high + i);
  voxels.above_low = hn::Sub(voxels.value, voxels.low);
  voxels.below_high = hn::Sub(voxels.high, voxels.value);
  return voxels;
}

// How a bound and its distance from the values change on edges between two voxels.
struct EdgeBound {
  Floats end, slope;
};

HWY_INLINE EdgeBound edgeBound(Floats bound, Floats distance, Floats end, Floats end_distance) {
  // Where the bound does not change it crosses nothing, and the slope is not looked at.
  return {end, hn::Div(hn::Sub(end_distance, distance), hn::Sub(end, bound))};
}

// The distance where the bound crosses an isovalue; `to_isovalue` is what it lacks at the
// beginning.
HWY_INLINE Floats distanceAt(const EdgeBound& edge, Floats distance, Floats to_isovalue,
                             Mask is_below, Mask end_is_below) {
  return hn::IfThenElseZero(hn::Xor(is_below, end_is_below),
                            hn::Add(distance, hn::Mul(to_isovalue, edge.slope)));
}

struct Edges {
  EdgeBound low, high;
};

HWY_INLINE Edges edgesBetween(const Bracketed& from, const Bracketed& to) {
  return {edgeBound(from.low, from.above_low, to.low, to.above_low),
          edgeBound(from.high, from.below_high, to.high, to.below_high)};
}

// What a vector of voxels and the edges from it say of an end of a bin, and so of both bins there.
struct AtEnd {
  Floats here, along_y, along_z;
};

HWY_INLINE AtEnd atNoEnd() {
  const Floats zero = hn::Zero(Tag());
  return {zero, zero, zero};
}

// The greatest of what is there and `errors`.
HWY_INLINE void include(Floats errors, float* at) {
  const Tag d;
  hn::StoreU(hn::Max(errors, hn::LoadU(d, at)), d, at);
}

HWY_INLINE void includeInto(const ErrorTargets& targets, const AtEnd& errors, std::int64_t bin,
                            std::int64_t i) {
  const Tag d;
  const Floats all = hn::Max(errors.here, hn::Max(errors.along_y, errors.along_z));
  if (hn::AllFalse(d, hn::Gt(all, hn::Zero(d)))) return;
  const auto bit = static_cast<RunBits>(1 << (i / kErrorRun));
  for (int n = 0; n < targets.count; ++n) {
    const ErrorTarget& to = targets.rows[n];
    Floats greatest = errors.here;
    if (to.has_y_edges) greatest = hn::Max(greatest, errors.along_y);
    if (to.has_z_edges) greatest = hn::Max(greatest, errors.along_z);
    include(greatest, to.at + bin * targets.row_stride + i);
    to.touched[bin] = static_cast<RunBits>(to.touched[bin] | bit);
  }
}

void includeErrorsOfRowHere(const BracketedRow& here, const BracketedRow& next_y,
                            const BracketedRow& next_z, std::int64_t count,
                            const IsovalueBins& bins, const ErrorTargets& targets) {
  const Tag d;
  const std::int64_t lanes = laneCount();
  const bool has_y = next_y.value != nullptr, has_z = next_z.value != nullptr;
  const Floats zero = hn::Zero(d);
  for (std::int64_t i = 0; i < count; i += lanes) {
    if ((targets.silent_runs >> (i / kErrorRun) & 1) != 0) continue;
    BinRun run = here.bins[i / kErrorRun];
    const auto takeIn = [&](const BinRun& other) {
      run.first = std::min(run.first, other.first);
      run.last = std::max(run.last, other.last);
    };
    if (has_y) takeIn(next_y.bins[i / kErrorRun]);
    if (has_z) takeIn(next_z.bins[i / kErrorRun]);
    const Bracketed a = load(here, i);
    if (run.first == run.last) {  // no edge leaves the bin
      includeInto(targets, {hn::Max(a.above_low, a.below_high), zero, zero}, run.first, i);
      continue;
    }
    const Mask is_x_edge =
        hn::FirstN(d, static_cast<std::size_t>(std::max(std::int64_t{0}, count - 1 - i)));
    const Mask is_end = hn::Ne(hn::LoadU(d, targets.is_end + i % 8), zero);
    const Edges x = edgesBetween(a, load(here, i + 1));
    const Edges y = edgesBetween(a, load(has_y ? next_y : here, i));
    const Edges z = edgesBetween(a, load(has_z ? next_z : here, i));
    AtEnd before = atNoEnd();
    Mask low_was_below = hn::FirstN(d, 0), high_was_below = low_was_below;
    for (std::int64_t bin = run.first; bin <= run.last; ++bin) {
      AtEnd after = atNoEnd();
      Mask low_is_below = hn::FirstN(d, kErrorRun), high_is_below = low_is_below;
      if (bin < run.last) {
        const Floats v = hn::Set(d, bins.ends[bin + 1]);
        low_is_below = hn::Lt(a.low, v);
        high_is_below = hn::Lt(a.high, v);
        const Floats to_low = hn::Sub(v, a.low), to_high = hn::Sub(v, a.high);
        const auto onEdges = [&](const Edges& edges) {
          return hn::Max(
              distanceAt(edges.low, a.above_low, to_low, low_is_below, hn::Lt(edges.low.end, v)),
              distanceAt(edges.high, a.below_high, to_high, high_is_below,
                         hn::Lt(edges.high.end, v)));
        };
        // A voxel inside (value >= v) may come out for v in (low, value], one outside in for v in
        // (value, high].
        const Floats inside = hn::Sub(a.value, v);
        const Floats voxel = hn::Max(hn::IfThenElseZero(low_is_below, inside),
                                     hn::IfThenZeroElse(high_is_below, hn::Neg(inside)));
        const Floats on_x = hn::IfThenElseZero(is_x_edge, onEdges(x));
        const Floats from_ends = hn::IfThenElseZero(is_end, on_x);
#if HWY_TARGET == HWY_SCALAR  // the only lane
        for (const std::int64_t to : {bin, bin + 1})
          includeInto(targets, {from_ends, zero, zero}, to, i + 1);
        const Floats to_within = zero;
#else
        const Floats to_within = hn::Shuffle2301(from_ends);  // ends are even
#endif
        after.here = hn::Max(voxel, hn::Max(hn::IfThenZeroElse(is_end, on_x), to_within));
        after.along_y = onEdges(y);
        after.along_z = onEdges(z);
      }
      const Floats own =
          hn::Max(hn::IfThenElseZero(hn::AndNot(low_was_below, low_is_below), a.above_low),
                  hn::IfThenElseZero(hn::AndNot(high_was_below, high_is_below), a.below_high));
      includeInto(targets,
                  {hn::Max(own, hn::Max(before.here, after.here)),
                   hn::Max(before.along_y, after.along_y), hn::Max(before.along_z, after.along_z)},
                  bin, i);
      before = after;
      low_was_below = low_is_below;
      high_was_below = high_is_below;
    }
  }
}

// ErrorCode::encodeUp.
HWY_INLINE hn::Vec<hn::RebindToSigned<Tag>> codesOf(Floats errors, Floats slack, Floats share) {
  const Tag d;
  const hn::RebindToSigned<Tag> di;
  const Floats units = hn::Mul(hn::Add(errors, slack), share);
  const auto bits = hn::Add(hn::BitCast(di, units), hn::Set(di, (1 << 19) - 1 - (127 << 23)));
  const auto code = hn::Min(hn::ShiftRight<19>(bits), hn::Set(di, 255));
  const auto is_some = hn::RebindMask(di, hn::Gt(errors, hn::Zero(d)));
  return hn::IfThenElseZero(is_some, hn::Max(code, hn::Set(di, 1)));
}

void takeCodesHere(float* errors, RunBits touched, std::int64_t count, std::int64_t step,
                   float slack, float units_per_error, std::uint8_t* codes) {
  const Tag d;
  const hn::RebindToSigned<Tag> di;
  const Floats slacks = hn::Set(d, slack), share = hn::Set(d, units_per_error);
  std::fill_n(errors + count, kErrorRun, 0.0f);
  const std::int64_t cells = (count - 1 + step - 1) / step;
  const auto includeCode = [&](std::int64_t cell, std::int32_t code) {
    codes[cell] = std::max(codes[cell], static_cast<std::uint8_t>(code));
  };
  HWY_ALIGN std::int32_t found[kErrorRun];
  for (std::int64_t run = 0; run * kErrorRun < count; ++run) {
    if ((touched >> run & 1) == 0) continue;
    const std::int64_t begin = run * kErrorRun;
    for (std::int64_t i = begin; i < begin + kErrorRun; i += std::max(step, laneCount())) {
      Floats greatest = hn::LoadU(d, errors + i);
      for (std::int64_t k = 1; k <= step; ++k)
        greatest = hn::Max(greatest, hn::LoadU(d, errors + i + k));
      hn::StoreU(codesOf(greatest, slacks, share), di, found);
      for (std::int64_t k = 0; k < std::max(step, laneCount()) && (i + k) / step < cells; k += step)
        includeCode((i + k) / step, found[k]);
    }
    // The voxel at the beginning is that of the cell before too.
    if (run > 0 && (touched >> (run - 1) & 1) == 0)
      includeCode(begin / step - 1, hn::GetLane(codesOf(hn::Set(d, errors[begin]), slacks, share)));
  }
  for (std::int64_t run = 0; run * kErrorRun < count; ++run)
    if ((touched >> run & 1) != 0) std::fill_n(errors + run * kErrorRun, kErrorRun, 0.0f);
}

// Whole vectors; the last one may overlap the one before, which changes nothing.
template <size_t kLanes>
HWY_INLINE bool includedGreater(const std::uint8_t* from, std::int64_t count, std::uint8_t* to) {
  const hn::CappedTag<std::uint8_t, kLanes> d;
  const auto lanes = static_cast<std::int64_t>(hn::Lanes(d));
  if (count < lanes) return false;
  for (std::int64_t i = 0; i < count; i += lanes) {
    const std::int64_t at = std::min(i, count - lanes);
    hn::StoreU(hn::Max(hn::LoadU(d, from + at), hn::LoadU(d, to + at)), d, to + at);
  }
  return true;
}

void includeGreaterHere(const std::uint8_t* from, std::int64_t from_stride, std::int64_t rows,
                        std::int64_t count, std::uint8_t* to) {
  for (std::int64_t row = 0; row < rows; ++row, from += from_stride)
    if (!includedGreater<32>(from, count, to) && !includedGreater<16>(from, count, to) &&
        !includedGreater<8>(from, count, to))
      for (std::int64_t i = 0; i < count; ++i) to[i] = std::max(to[i], from[i]);
}

void includeRangeHere(const float* values, std::int64_t count, float* least, float* greatest) {
  const Tag d;
  std::int64_t i = 0;
  for (; i + laneCount() <= count; i += laneCount()) {
    const Floats v = hn::LoadU(d, values + i);
    hn::StoreU(hn::Min(v, hn::LoadU(d, least + i)), d, least + i);
    hn::StoreU(hn::Max(v, hn::LoadU(d, greatest + i)), d, greatest + i);
  }
  for (; i < count; ++i) {
    least[i] = std::min(least[i], values[i]);
    greatest[i] = std::max(greatest[i], values[i]);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace isobrick
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace isobrick {

HWY_EXPORT(interpolateRowHere);
HWY_EXPORT(boundRowHere);
HWY_EXPORT(includeErrorsOfRowHere);
HWY_EXPORT(takeCodesHere);
HWY_EXPORT(includeGreaterHere);
HWY_EXPORT(includeRangeHere);

void interpolateRow(const float* from, const float* to, float share, std::int64_t count,
                    float* out) {
  HWY_DYNAMIC_DISPATCH(interpolateRowHere)(from, to, share, count, out);
}

void boundRow(const RowBetween& row, const float* value, std::int64_t count,
              const IsovalueBins& bins, float* low, float* high, BinRun* runs) {
  HWY_DYNAMIC_DISPATCH(boundRowHere)(row, value, count, bins, low, high, runs);
}

void includeErrorsOfRow(const BracketedRow& here, const BracketedRow& next_y,
                        const BracketedRow& next_z, std::int64_t count, const IsovalueBins& bins,
                        const ErrorTargets& targets) {
  HWY_DYNAMIC_DISPATCH(includeErrorsOfRowHere)(here, next_y, next_z, count, bins, targets);
}

void takeCodes(float* errors, RunBits touched, std::int64_t count, std::int64_t step, float slack,
               float units_per_error, std::uint8_t* codes) {
  HWY_DYNAMIC_DISPATCH(takeCodesHere)
  (errors, touched, count, step, slack, units_per_error, codes);
}

void includeGreater(const std::uint8_t* from, std::int64_t from_stride, std::int64_t rows,
                    std::int64_t count, std::uint8_t* to) {
  HWY_DYNAMIC_DISPATCH(includeGreaterHere)(from, from_stride, rows, count, to);
}

void includeRange(const float* values, std::int64_t count, float* least, float* greatest) {
  HWY_DYNAMIC_DISPATCH(includeRangeHere)(values, count, least, greatest);
}

}  // namespace isobrick
#endif
