#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "isobrick/preprocess/kernels/error_rows.cpp"
#include "isobrick/preprocess/kernels/error_rows.h"

#include <hwy/foreach_target.h>  // must come before highway.h
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace isobrick {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using Tag = hn::CappedTag<float, 16>;
using Floats = hn::Vec<Tag>;
using Mask = hn::Mask<Tag>;

// Voxels with the bounds of the coarse field.
struct Bracketed {
  Floats value, low, high;
};

HWY_INLINE Bracketed load(const BracketedRow& row, std::int64_t i) {
  const Tag d;
  return {hn::LoadU(d, row.value + i), hn::LoadU(d, row.low + i), hn::LoadU(d, row.high + i)};
}

// An edge between two voxels. Values change linearly on the way from one to the other.
struct Edge {
  Bracketed from, change;
  // Of 1 / change; where nothing changes a large number takes its place, so that what lies on the
  // right side is reached nowhere on the edge, and what lies on the wrong side everywhere.
  Floats low_rate, high_rate;
  Mask low_rises, high_rises;
  Floats least, greatest;  // where the coarse field may be on it
};

HWY_INLINE Edge edgeBetween(const Bracketed& a, const Bracketed& b) {
  const Tag d;
  const Floats zero = hn::Zero(d), one = hn::Set(d, 1.0f), steep = hn::Set(d, 0x1p100f);
  const auto rateOf = [&](Floats change) {
    return hn::IfThenElse(hn::Eq(change, zero), steep, hn::Div(one, change));
  };
  Edge edge;
  edge.from = a;
  edge.change = {hn::Sub(b.value, a.value), hn::Sub(b.low, a.low), hn::Sub(b.high, a.high)};
  edge.low_rate = rateOf(edge.change.low);
  edge.high_rate = rateOf(edge.change.high);
  edge.low_rises = hn::Ge(edge.change.low, zero);
  edge.high_rises = hn::Gt(edge.change.high, zero);
  edge.least = hn::Min(a.low, b.low);
  edge.greatest = hn::Max(a.high, b.high);
  return edge;
}

HWY_INLINE Mask mayCross(const Edge& edge, Floats least, Floats greatest) {
  return hn::And(hn::Le(edge.least, greatest), hn::Ge(edge.greatest, least));
}

// The field, somewhere between low(t) and high(t), may be an isovalue v in [least, greatest] where
// low(t) <= greatest and high(t) >= least: an interval of t. There value(t) - v is at most
// value - low, and at most value - least; both linear, with their greatest at the interval's ends.
// The same downwards.
HWY_INLINE Floats edgeError(const Edge& edge, Floats least, Floats greatest) {
  const Tag d;
  const Floats zero = hn::Zero(d), one = hn::Set(d, 1.0f);
  const Floats low_end = hn::Mul(hn::Sub(greatest, edge.from.low), edge.low_rate);
  const Floats high_end = hn::Mul(hn::Sub(least, edge.from.high), edge.high_rate);
  // Rounding, a few 2^-24 of what is on the way, may cut a little off: isovalues have more room.
  const Floats from = hn::Max(hn::Max(zero, hn::IfThenElse(edge.low_rises, zero, low_end)),
                              hn::IfThenElse(edge.high_rises, high_end, zero));
  const Floats to = hn::Min(hn::Min(one, hn::IfThenElse(edge.low_rises, low_end, one)),
                            hn::IfThenElse(edge.high_rises, one, high_end));
  const Mask is_crossed =
      hn::And(hn::Le(from, hn::Add(to, hn::Set(d, 0x1p-20f))), mayCross(edge, least, greatest));
  const auto at = [](Floats begin, Floats change, Floats t) {
    return hn::Add(begin, hn::Mul(t, change));
  };
  const Floats value_from = at(edge.from.value, edge.change.value, from);
  const Floats value_to = at(edge.from.value, edge.change.value, to);
  const Floats above_low = hn::Max(hn::Sub(value_from, at(edge.from.low, edge.change.low, from)),
                                   hn::Sub(value_to, at(edge.from.low, edge.change.low, to)));
  const Floats below_high = hn::Max(hn::Sub(at(edge.from.high, edge.change.high, from), value_from),
                                    hn::Sub(at(edge.from.high, edge.change.high, to), value_to));
  const Floats up = hn::Min(above_low, hn::Sub(hn::Max(value_from, value_to), least));
  const Floats down = hn::Min(below_high, hn::Sub(greatest, hn::Min(value_from, value_to)));
  return hn::IfThenElseZero(is_crossed, hn::Max(zero, hn::Max(up, down)));
}

// A voxel inside (value >= v) may come out for v in (low, value], one outside in for v in
// (value, high].
HWY_INLINE Floats voxelError(const Bracketed& a, Floats least, Floats greatest) {
  const Tag d;
  const Floats up =
      hn::IfThenElseZero(hn::Le(a.low, greatest), hn::Sub(a.value, hn::Max(a.low, least)));
  const Floats down =
      hn::IfThenElseZero(hn::Ge(a.high, least), hn::Sub(hn::Min(a.high, greatest), a.value));
  return hn::Max(hn::Zero(d), hn::Max(up, down));
}

// The greatest of what is there and `errors`.
HWY_INLINE void include(Floats errors, float* at) {
  const Tag d;
  hn::StoreU(hn::Max(errors, hn::LoadU(d, at)), d, at);
}

// The bins that may hold an isovalue between the two.
struct BinRun {
  std::int64_t first, last;
};
HWY_INLINE BinRun binsBetween(const IsovalueBins& bins, float low, float high) {
  const auto last = static_cast<float>(bins.count - 1);
  const auto binOf = [&](float value, float room) {
    const float bin = (value - bins.first) / bins.width + room;
    return static_cast<std::int64_t>(bin < 0 ? 0 : bin > last ? last : bin);
  };
  return {binOf(low, -bins.room), binOf(high, bins.room)};
}

void includeErrorsOfRowHere(const BracketedRow& here, const BracketedRow& next_y,
                            const BracketedRow& next_z, std::int64_t count,
                            const IsovalueBins& bins, const ErrorTargets& targets) {
  const Tag d;
  const auto lanes = static_cast<std::int64_t>(hn::Lanes(d));
  const bool has_y = next_y.value != nullptr, has_z = next_z.value != nullptr;
  for (std::int64_t i = 0; i < count; i += lanes) {
    // What lies behind the last voxel has no errors.
    const Mask is_voxel = hn::FirstN(d, static_cast<std::size_t>(count - i));
    const Mask is_edge = hn::FirstN(d, static_cast<std::size_t>(count - 1 - i));
    const Bracketed a = load(here, i);
    const auto binsOf = [&](Floats low, Floats high) {
      return binsBetween(bins, hn::GetLane(hn::MinOfLanes(d, hn::IfThenElse(is_voxel, low, a.low))),
                         hn::GetLane(hn::MaxOfLanes(d, hn::IfThenElse(is_voxel, high, a.high))));
    };
    // Errors of a bin go to the intervals that begin with the voxels, and to those that end there.
    const auto includeInto = [&](const GreatestErrors* to, int number, std::int64_t bin,
                                 Floats begins, Floats ends) {
      const std::int64_t at = bin * targets.row_stride + i;
      for (int n = 0; n < number; ++n) {
        include(begins, to[n].at + at);
        include(ends, to[n].at + at - 1);
        to[n].is_touched[bin] = 1;
      }
    };
    const auto isNowhere = [&](Mask mask) { return hn::AllFalse(d, hn::And(mask, is_voxel)); };

    const Edge along_x = edgeBetween(a, load(here, i + 1));
    const BinRun run_x =
        binsOf(hn::Min(along_x.least, a.value), hn::Max(along_x.greatest, a.value));
    for (std::int64_t bin = run_x.first; bin <= run_x.last; ++bin) {
      const Floats least = hn::Set(d, bins.least[bin]), greatest = hn::Set(d, bins.greatest[bin]);
      const Floats voxel = hn::IfThenElseZero(is_voxel, voxelError(a, least, greatest));
      const Floats edge = hn::IfThenElseZero(is_edge, edgeError(along_x, least, greatest));
      const Floats both = hn::Max(voxel, edge);
      if (isNowhere(hn::Gt(both, hn::Zero(d)))) continue;
      includeInto(targets.here, targets.here_count, bin, both, voxel);
    }
    const auto includeAcross = [&](const BracketedRow& next, const GreatestErrors* to, int number) {
      const Edge edge = edgeBetween(a, load(next, i));
      const BinRun run = binsOf(edge.least, edge.greatest);
      for (std::int64_t bin = run.first; bin <= run.last; ++bin) {
        const Floats least = hn::Set(d, bins.least[bin]), greatest = hn::Set(d, bins.greatest[bin]);
        if (isNowhere(mayCross(edge, least, greatest))) continue;
        const Floats error = hn::IfThenElseZero(is_voxel, edgeError(edge, least, greatest));
        includeInto(to, number, bin, error, error);
      }
    };
    if (has_y) includeAcross(next_y, targets.along_y, targets.along_y_count);
    if (has_z) includeAcross(next_z, targets.along_z, targets.along_z_count);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace isobrick
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace isobrick {

HWY_EXPORT(includeErrorsOfRowHere);

void includeErrorsOfRow(const BracketedRow& here, const BracketedRow& next_y,
                        const BracketedRow& next_z, std::int64_t count, const IsovalueBins& bins,
                        const ErrorTargets& targets) {
  HWY_DYNAMIC_DISPATCH(includeErrorsOfRowHere)(here, next_y, next_z, count, bins, targets);
}

}  // namespace isobrick
#endif
