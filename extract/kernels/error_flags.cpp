#define HWY_WANT_AVX3_DL
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "isobrick/extract/kernels/error_flags.cpp"
#include "isobrick/extract/kernels/error_flags.h"

#include <hwy/foreach_target.h>  // must come before highway.h
#include <hwy/highway.h>

#include <cstring>

HWY_BEFORE_NAMESPACE();
namespace isobrick {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using Tag = hn::CappedTag<float, 16>;
using Floats = hn::Vec<Tag>;
using Mask = hn::Mask<Tag>;

// The ends of an edge: the voxels' values less the isovalue, and the bounds of the coarse field,
// likewise.
struct End {
  Floats value, low, high;
};

HWY_INLINE End load(const BoundedRow& row, std::int64_t i, Floats isovalue) {
  const Tag d;
  return {hn::Sub(hn::LoadU(d, row.value + i), isovalue),
          hn::Sub(hn::LoadU(d, row.low + i), isovalue),
          hn::Sub(hn::LoadU(d, row.high + i), isovalue)};
}

// Where the coarse field, somewhere between its bounds, may be 0 on the edge: for a t with
// low(t) <= 0 <= high(t), both linear, an interval. Whether the voxels' value, linear too, is
// beyond the tolerance at one of its ends.
HWY_INLINE Mask isTooFar(Floats value_a, Floats value_b, Floats low_a, Floats low_b, Floats high_a,
                         Floats high_b, Floats tolerance) {
  const Tag d;
  const Floats zero = hn::Zero(d), one = hn::Set(d, 1.0f);
  // From where to where bound(t) >= 0; an empty interval where it is nowhere.
  Floats from = zero, to = one;
  const auto cut = [&](Floats bound_a, Floats bound_b) {
    const Mask a = hn::Ge(bound_a, zero), b = hn::Ge(bound_b, zero);
    const Floats root = hn::Div(bound_a, hn::Sub(bound_a, bound_b));
    from = hn::IfThenElse(hn::And(hn::Not(a), b), hn::Max(from, root), from);
    to = hn::IfThenElse(hn::And(a, hn::Not(b)), hn::Min(to, root), to);
    to = hn::IfThenElse(hn::Not(hn::Or(a, b)), hn::Set(d, -1.0f), to);
  };
  cut(hn::Neg(low_a), hn::Neg(low_b));
  cut(high_a, high_b);
  // Rounding may part two roots that meet. A field that is nowhere below the isovalue touches it
  // and does not cross.
  const Mask crosses =
      hn::And(hn::Le(from, hn::Add(to, hn::Set(d, 0x1p-20f))), hn::Lt(hn::Min(low_a, low_b), zero));
  const auto errorAt = [&](Floats t) {
    return hn::Abs(hn::Add(value_a, hn::Mul(t, hn::Sub(value_b, value_a))));
  };
  return hn::And(crosses, hn::Gt(hn::Max(errorAt(from), errorAt(to)), tolerance));
}

HWY_INLINE void store(Mask mask, std::uint8_t flag, std::int64_t i, std::uint8_t* flags) {
  const hn::Rebind<std::uint8_t, Tag> d8;
  const hn::RebindToSigned<Tag> d32;
  const auto set = hn::DemoteTo(
      d8, hn::IfThenElseZero(hn::RebindMask(d32, mask), hn::Set(d32, static_cast<int>(flag))));
  hn::StoreU(hn::Or(hn::LoadU(d8, flags + i), set), d8, flags + i);
}

void flagVoxelsHere(const BoundedRow& row, std::int64_t count, const ErrorBound& bound,
                    std::uint8_t* flags) {
  const Tag d;
  const Floats isovalue = hn::Set(d, bound.isovalue), tolerance = hn::Set(d, bound.tolerance);
  const Floats zero = hn::Zero(d);
  for (std::int64_t i = 0; i < count; i += static_cast<std::int64_t>(hn::Lanes(d))) {
    const End end = load(row, i, isovalue);
    const Mask is_inside = hn::Ge(end.value, zero);
    const Mask is_wrong = hn::Or(hn::And(is_inside, hn::Lt(end.low, zero)),
                                 hn::AndNot(is_inside, hn::Ge(end.high, zero)));
    store(hn::And(is_wrong, hn::Gt(hn::Abs(end.value), tolerance)), kWrongSide, i, flags);
  }
}

// Where nothing crosses there is no error; that is so nearly everywhere.
HWY_INLINE Mask mayCross(const End& a, const End& b) {
  const Tag d;
  const Floats least = hn::Min(hn::Min(a.value, a.low), hn::Min(b.value, b.low));
  const Floats greatest = hn::Max(hn::Max(a.value, a.high), hn::Max(b.value, b.high));
  return hn::And(hn::Lt(least, hn::Zero(d)), hn::Ge(greatest, hn::Zero(d)));
}

void flagEdgesHere(const BoundedRow& row, const BoundedRow& other, std::int64_t count,
                   const ErrorBound& bound, std::uint8_t* flags) {
  const Tag d;
  const Floats isovalue = hn::Set(d, bound.isovalue), tolerance = hn::Set(d, bound.tolerance);
  for (std::int64_t i = 0; i < count; i += static_cast<std::int64_t>(hn::Lanes(d))) {
    const End a = load(row, i, isovalue), b = load(other, i, isovalue);
    if (hn::AllFalse(d, mayCross(a, b))) continue;
    store(isTooFar(a.value, b.value, a.low, b.low, a.high, b.high, tolerance), kCoarseEdge, i,
          flags);
    store(isTooFar(a.value, b.value, a.low, b.value, a.high, b.value, tolerance), kLowHangs, i,
          flags);
    store(isTooFar(a.value, b.value, a.value, b.low, a.value, b.high, tolerance), kHighHangs, i,
          flags);
  }
}

bool hasCoarseEdgeHere(const BoundedRow& row, const BoundedRow& other, std::uint32_t edges,
                       const ErrorBound& bound) {
  const Tag d;
  const Floats isovalue = hn::Set(d, bound.isovalue), tolerance = hn::Set(d, bound.tolerance);
  const auto lanes = static_cast<std::int64_t>(hn::Lanes(d));
  for (std::int64_t i = 0; i < 32; i += lanes) {
    const std::uint32_t rest = edges >> i;
    if (rest == 0) break;
    std::uint8_t bits[sizeof(rest)];
    std::memcpy(bits, &rest, sizeof(rest));
    const End a = load(row, i, isovalue), b = load(other, i, isovalue);
    const Mask may_cross = hn::And(hn::LoadMaskBits(d, bits), mayCross(a, b));
    if (hn::AllFalse(d, may_cross)) continue;
    const Mask is_too_far = isTooFar(a.value, b.value, a.low, b.low, a.high, b.high, tolerance);
    if (!hn::AllFalse(d, hn::And(may_cross, is_too_far))) return true;
  }
  return false;
}

}  // namespace HWY_NAMESPACE
}  // namespace isobrick
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace isobrick {

HWY_EXPORT(flagVoxelsHere);
HWY_EXPORT(flagEdgesHere);
HWY_EXPORT(hasCoarseEdgeHere);

void flagVoxels(const BoundedRow& row, std::int64_t count, const ErrorBound& bound,
                std::uint8_t* flags) {
  HWY_DYNAMIC_DISPATCH(flagVoxelsHere)(row, count, bound, flags);
}

void flagEdges(const BoundedRow& row, const BoundedRow& other, std::int64_t count,
               const ErrorBound& bound, std::uint8_t* flags) {
  HWY_DYNAMIC_DISPATCH(flagEdgesHere)(row, other, count, bound, flags);
}

bool hasCoarseEdge(const BoundedRow& row, const BoundedRow& other, std::uint32_t edges,
                   const ErrorBound& bound) {
  return HWY_DYNAMIC_DISPATCH(hasCoarseEdgeHere)(row, other, edges, bound);
}

}  // namespace isobrick
#endif
