#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "isobrick/preprocess/kernels/low_pass.cpp"
#include "isobrick/preprocess/kernels/low_pass.h"

#include <hwy/foreach_target.h>  // must come before highway.h
#include <hwy/highway.h>

#include <algorithm>
#include <array>
#include <type_traits>
#include <vector>

#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/voxel_type.h"

HWY_BEFORE_NAMESPACE();
namespace isobrick {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Exact sums: 64 times the largest voxel of 8 bits fits 16, of 16 bits fits 32.
template <typename T>
using LowPassSum =
    std::conditional_t<std::is_floating_point_v<T>, double,
                       std::conditional_t<sizeof(T) == 1, std::int16_t, std::int32_t>>;

// Calls `f(x)` so that vectors of `lanes` elements from x on cover [0, count) and nothing else: the
// last one overlaps the one before. False if count < lanes.
template <typename F>
bool coverWithVectors(std::int64_t count, std::int64_t lanes, F&& f) {
  if (count < lanes) return false;
  for (std::int64_t x = 0; x + lanes < count; x += lanes) f(x);
  f(count - lanes);
  return true;
}

// out = a + 2 b + c over voxels.
template <typename T>
void addVoxelRows(const T* a, const T* b, const T* c, std::int64_t count, LowPassSum<T>* out) {
  using Sum = LowPassSum<T>;
  const hn::ScalableTag<Sum> sums;
  const hn::Rebind<T, hn::ScalableTag<Sum>> voxels;
  const auto lanes = static_cast<std::int64_t>(hn::Lanes(sums));
  const bool done = coverWithVectors(count, lanes, [&](std::int64_t x) {
    const auto load = [&](const T* row) { return hn::PromoteTo(sums, hn::LoadU(voxels, row + x)); };
    const auto middle = load(b);
    hn::StoreU(hn::Add(hn::Add(load(a), hn::Add(middle, middle)), load(c)), sums, out + x);
  });
  if (done) return;
  for (std::int64_t x = 0; x < count; ++x)
    out[x] = static_cast<Sum>(static_cast<Sum>(a[x]) + 2 * static_cast<Sum>(b[x]) +
                              static_cast<Sum>(c[x]));
}

template <typename T>
void copyVoxelRow(const T* row, std::int64_t count, LowPassSum<T>* out) {
  for (std::int64_t x = 0; x < count; ++x) out[x] = static_cast<LowPassSum<T>>(row[x]);
}

// out = a + 2 b + c over sums.
template <typename Sum>
void addSumRows(const Sum* a, const Sum* b, const Sum* c, std::int64_t count, Sum* out) {
  const hn::ScalableTag<Sum> sums;
  const auto lanes = static_cast<std::int64_t>(hn::Lanes(sums));
  const bool done = coverWithVectors(count, lanes, [&](std::int64_t x) {
    const auto middle = hn::LoadU(sums, b + x);
    hn::StoreU(
        hn::Add(hn::Add(hn::LoadU(sums, a + x), hn::Add(middle, middle)), hn::LoadU(sums, c + x)),
        sums, out + x);
  });
  if (done) return;
  for (std::int64_t x = 0; x < count; ++x) out[x] = static_cast<Sum>(a[x] + 2 * b[x] + c[x]);
}

// One division, one rounding: by 4 for every filtered axis.
template <typename T>
T divideRounding(LowPassSum<T> sum, int filtered_axes) {
  const int shift = 2 * filtered_axes;
  if constexpr (std::is_floating_point_v<T>) {
    return static_cast<T>(sum / (1 << shift));
  } else {
    const std::int32_t half = shift > 0 ? 1 << (shift - 1) : 0;
    return static_cast<T>((sum + half) >> shift);  // arithmetic shift: halves go up
  }
}

// out[i] = (s[2i-1] + 2 s[2i] + s[2i+1]) / 4^(filtered_axes + 1), rounded, for i in [0, count).
template <typename T>
void filterRow(const LowPassSum<T>* s, std::int64_t count, int filtered_axes, T* out) {
  using Sum = LowPassSum<T>;
#if HWY_TARGET == HWY_SCALAR
  const bool done = false;  // one lane has no even and odd ones
#else
  const hn::ScalableTag<Sum> sums;
  const hn::Rebind<T, hn::ScalableTag<Sum>> voxels;
  const auto lanes = static_cast<std::int64_t>(hn::Lanes(sums));
  const int shift = 2 * filtered_axes + 2;
  const bool done = coverWithVectors(count, lanes, [&](std::int64_t i) {
    const auto at = [&](std::int64_t x) {
      const auto middle = hn::LoadU(sums, s + x);
      return hn::Add(hn::Add(hn::LoadU(sums, s + x - 1), hn::Add(middle, middle)),
                     hn::LoadU(sums, s + x + 1));
    };
    const auto even = hn::ConcatEven(sums, at(2 * i + lanes), at(2 * i));
    if constexpr (std::is_floating_point_v<T>) {
      const auto scale = hn::Set(sums, 1.0 / (1 << shift));  // a power of two: exact
      hn::StoreU(hn::DemoteTo(voxels, hn::Mul(even, scale)), voxels, out + i);
    } else {
      const auto half = hn::Set(sums, static_cast<Sum>(1 << (shift - 1)));
      hn::StoreU(hn::DemoteTo(voxels, hn::ShiftRightSame(hn::Add(even, half), shift)), voxels,
                 out + i);
    }
  });
#endif
  if (done) return;
  for (std::int64_t i = 0; i < count; ++i)
    out[i] = divideRounding<T>(static_cast<Sum>(s[2 * i - 1] + 2 * s[2 * i] + s[2 * i + 1]),
                               filtered_axes + 1);
}

template <typename T>
void lowPass(const Lattice& lattice, int level, format::Filter filter, const SampleBlock<T>& fine,
             const IndexBox& coarse, T* out) {
  using Sum = LowPassSum<T>;
  const auto tap = [&](int axis, std::int64_t i) {
    return lowPassTap(lattice, level, filter, axis, i);
  };
  const IndexBox support = lowPassSupport(lattice, level, filter, coarse);
  const std::int64_t width = support.count.x, height = support.count.y;
  // Vectors of the last step read up to two vectors past the last sum that counts.
  const auto padding = static_cast<std::int64_t>(4 * hn::Lanes(hn::ScalableTag<Sum>()));
  thread_local std::vector<Sum> slice_sums, row_sums;
  slice_sums.resize(static_cast<std::size_t>(width * height));
  row_sums.assign(static_cast<std::size_t>(1 + width + padding), Sum{0});
  Sum* const sums = row_sums.data() + 1;

  // The samples along x that are filtered; outside of them only border samples lie.
  std::int64_t begin = coarse.first.x, end = coarse.end().x;
  while (begin < end && !tap(0, begin).filtered) ++begin;
  while (end > begin && !tap(0, end - 1).filtered) --end;
  const auto column = [&](std::int64_t i) { return tap(0, i).center - support.first.x; };

  for (std::int64_t k = coarse.first.z; k < coarse.end().z; ++k) {
    const LowPassTap tz = tap(2, k);
    for (std::int64_t y = support.first.y; y < support.end().y; ++y) {
      const auto row = [&](std::int64_t z) {
        return fine.row(y, z) + (support.first.x - fine.box.first.x);
      };
      Sum* const to = slice_sums.data() + (y - support.first.y) * width;
      if (tz.filtered)
        addVoxelRows<T>(row(tz.center - 1), row(tz.center), row(tz.center + 1), width, to);
      else
        copyVoxelRow<T>(row(tz.center), width, to);
    }
    for (std::int64_t j = coarse.first.y; j < coarse.end().y; ++j, out += coarse.count.x) {
      const LowPassTap ty = tap(1, j);
      const Sum* const middle = slice_sums.data() + (ty.center - support.first.y) * width;
      if (ty.filtered)
        addSumRows<Sum>(middle - width, middle, middle + width, width, sums);
      else
        std::copy_n(middle, width, sums);
      const int axes = (tz.filtered ? 1 : 0) + (ty.filtered ? 1 : 0);
      for (std::int64_t i = coarse.first.x; i < begin; ++i)
        out[i - coarse.first.x] = divideRounding<T>(sums[column(i)], axes);
      if (begin < end)
        filterRow<T>(sums + column(begin), end - begin, axes, out + (begin - coarse.first.x));
      for (std::int64_t i = end; i < coarse.end().x; ++i)
        out[i - coarse.first.x] = divideRounding<T>(sums[column(i)], axes);
    }
  }
}

// Highway dispatches functions, not templates, so this is one for all voxel types: `fine` is a
// SampleBlock<T>, `out` an array of T.
void lowPassOfType(VoxelType type, const Lattice& lattice, int level, format::Filter filter,
                   const void* fine, const IndexBox& coarse, void* out) {
  visitVoxelType(type, [&](auto tag) {
    using T = typename decltype(tag)::Type;
    lowPass<T>(lattice, level, filter, *static_cast<const SampleBlock<T>*>(fine), coarse,
               static_cast<T*>(out));
  });
}

}  // namespace HWY_NAMESPACE
}  // namespace isobrick
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace isobrick {

LowPassTap lowPassTap(const Lattice& lattice, int level, format::Filter filter, int axis,
                      std::int64_t i) {
  const std::int64_t last = lattice.samples(level)[axis] - 1;
  const std::int64_t center = std::min(2 * i, last);
  const bool has_both_neighbours = center > 0 && center < last;
  const bool right_is_regular = ((center + 1) << level) <= lattice.voxels()[axis] - 1;
  return {center, filter == format::Filter::kAverage && has_both_neighbours && right_is_regular};
}

IndexBox lowPassSupport(const Lattice& lattice, int level, format::Filter filter,
                        const IndexBox& coarse) {
  IndexBox support;
  for (int axis = 0; axis < 3; ++axis) {
    // The second to last sample can be filtered although the clamped last one is not.
    std::int64_t last = 0;
    for (std::int64_t i = std::max(coarse.first[axis], coarse.end()[axis] - 2);
         i < coarse.end()[axis]; ++i)
      last = std::max(last, lowPassTap(lattice, level, filter, axis, i).last());
    support.first[axis] = lowPassTap(lattice, level, filter, axis, coarse.first[axis]).first();
    support.count[axis] = last + 1 - support.first[axis];
  }
  return support;
}

HWY_EXPORT(lowPassOfType);

namespace {

// One coarse sample, beside a NaN. An axis that is not filtered counts four times.
float lowPassBesideMissing(const SampleBlock<float>& fine, const std::array<LowPassTap, 3>& taps) {
  const auto filtered = [](const LowPassTap& tap, auto&& at) {
    const double middle = at(tap.center);
    if (!tap.filtered) return middle;
    const double sum = (at(tap.center - 1) + 2 * middle) + at(tap.center + 1);
    return sum != sum ? 4 * middle : sum;
  };
  const double sum = filtered(taps[0], [&](std::int64_t i) {
    return filtered(taps[1], [&](std::int64_t j) {
      return filtered(taps[2], [&](std::int64_t k) {
        return static_cast<double>(fine.at({i, j, k}));
      });
    });
  });
  int shift = 0;
  for (const LowPassTap& tap : taps) shift += tap.filtered ? 2 : 0;
  return static_cast<float>(sum / (1 << shift));
}

}  // namespace

template <typename T>
void lowPassBlock(const Lattice& lattice, int level, format::Filter filter,
                  const SampleBlock<T>& fine, const IndexBox& coarse, T* out, bool has_missing) {
  HWY_DYNAMIC_DISPATCH(lowPassOfType)
  (voxelTypeOf<T>(), lattice, level, filter, &fine, coarse, out);
  if constexpr (std::is_same_v<T, float>) {
    if (!has_missing) return;
    forEachIndex(coarse, [&](const Index3& at) {
      float& sample = *out++;
      if (sample == sample) return;
      std::array<LowPassTap, 3> taps;
      for (int axis = 0; axis < 3; ++axis)
        taps[static_cast<std::size_t>(axis)] = lowPassTap(lattice, level, filter, axis, at[axis]);
      const float center = fine.at({taps[0].center, taps[1].center, taps[2].center});
      sample = center == center ? lowPassBesideMissing(fine, taps) : center;
    });
  }
}

#define ISOBRICK_INSTANTIATE(T)                                                             \
  template void lowPassBlock<T>(const Lattice&, int, format::Filter, const SampleBlock<T>&, \
                                const IndexBox&, T*, bool);
ISOBRICK_FOR_EACH_VOXEL_TYPE(ISOBRICK_INSTANTIATE)
#undef ISOBRICK_INSTANTIATE

}  // namespace isobrick
#endif
