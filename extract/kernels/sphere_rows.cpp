#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "isobrick/extract/kernels/sphere_rows.cpp"
#include "isobrick/extract/kernels/sphere_rows.h"

#include <hwy/foreach_target.h>  // must come before highway.h
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace isobrick {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

void cutSphereRows(SphereRows& rows) {
  // If the sphere's radius is at most this many cells, all roundings together, those of the squared
  // distances too, move an end by less than 2^-24.5 of it: even where the row only touches it, and
  // a square root of the difference of two nearly equal numbers is taken.
  constexpr double kMostReach = 0x1p16, kDoubt = 0x1p-8;
  const hn::CappedTag<double, SphereRows::kMost> d;
  const double cells = 1.0 / rows.edge;
  const double dz = (static_cast<double>(rows.first.z) + 0.5) * rows.edge - rows.center.z;
  const auto within = hn::Set(d, rows.within_squared), nothing = hn::Zero(d);
  const auto count = hn::Set(d, static_cast<double>(rows.count));
  const auto at =  // of the centre
      hn::Set(d, rows.center.x * cells - static_cast<double>(rows.first.x) - 0.5);
  const bool is_small = rows.within_squared * (cells * cells) <= kMostReach * kMostReach;
  const auto least_doubt = hn::Set(d, is_small ? kDoubt : 1.0);
  const auto isCertain = [&](auto x) {
    return hn::Gt(hn::Abs(hn::Sub(x, hn::Round(x))), least_doubt);
  };
  for (std::size_t n = 0; n < SphereRows::kMost; n += hn::Lanes(d)) {
    const auto y = hn::Iota(d, static_cast<double>(rows.first.y) + static_cast<double>(n));
    const auto dy = hn::Sub(hn::Mul(hn::Add(y, hn::Set(d, 0.5)), hn::Set(d, rows.edge)),
                            hn::Set(d, rows.center.y));
    // RowDistance::squaredBesideX(), to the bit
    const auto beside = hn::Add(hn::Mul(dy, dy), hn::Set(d, dz * dz));
    const auto is_out = hn::Ge(beside, within);
    const auto half =
        hn::Mul(hn::Sqrt(hn::Max(hn::Sub(within, beside), nothing)), hn::Set(d, cells));
    const auto low = hn::Sub(at, half), high = hn::Add(at, half);
    const auto begin = hn::Min(hn::Max(hn::Ceil(low), nothing), count);
    const auto end = hn::Min(hn::Max(hn::Ceil(high), nothing), count);
    const auto is_certain = hn::Or(hn::And(isCertain(low), isCertain(high)), is_out);
    hn::Store(begin, d, rows.begin.data() + n);
    hn::Store(hn::IfThenElse(is_out, begin, end), d, rows.end.data() + n);
    hn::Store(hn::IfThenElse(is_certain, hn::Set(d, 1.0), nothing), d, rows.is_certain.data() + n);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace isobrick
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace isobrick {

HWY_EXPORT(cutSphereRows);

void SphereRows::cut() { HWY_DYNAMIC_DISPATCH(cutSphereRows)(*this); }

}  // namespace isobrick
#endif
