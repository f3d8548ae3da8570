#include "preprocess/low_pass.h"

#include <type_traits>
#include <vector>

#include "storage/brick_layout.h"
#include "storage/voxel_type.h"

namespace isobrick {

LowPassTap lowPassTap(const Lattice& lattice, int level, int axis, std::int64_t i) {
  const std::int64_t last = lattice.samples(level)[axis] - 1;
  const std::int64_t center = std::min(2 * i, last);
  const bool has_both_neighbours = center > 0 && center < last;
  const bool right_is_regular = ((center + 1) << level) <= lattice.voxels()[axis] - 1;
  return {center, has_both_neighbours && right_is_regular};
}

namespace {

// Exact sums: 64 times the largest 16-bit voxel fits 32 bits.
template <typename T>
using Sum = std::conditional_t<std::is_floating_point_v<T>, double, std::int32_t>;

// out[i] = weighted sum along x of `row` for every coarse sample; weights 1 2 1, or 1 alone.
template <typename T>
void filterRow(const std::vector<LowPassTap>& taps, const T* row, Sum<T>* out) {
  for (std::size_t i = 0; i < taps.size(); ++i) {
    const T* at = row + taps[i].center;
    out[i] = taps[i].filtered ? static_cast<Sum<T>>(at[-1]) + 2 * static_cast<Sum<T>>(at[0]) +
                                    static_cast<Sum<T>>(at[1])
                              : static_cast<Sum<T>>(at[0]);
  }
}

// One division, one rounding: by 4 for every filtered axis.
template <typename T>
T divideRounding(Sum<T> sum, int filtered_axes) {
  const int shift = 2 * filtered_axes;
  if constexpr (std::is_floating_point_v<T>) {
    return static_cast<T>(sum / (1 << shift));
  } else {
    const std::int32_t half = shift > 0 ? 1 << (shift - 1) : 0;
    return static_cast<T>((sum + half) >> shift);  // arithmetic shift: halves go up
  }
}

}  // namespace

template <typename T>
void lowPassSlices(const Lattice& lattice, int level, format::Filter filter, const T* fine,
                   std::int64_t first, std::int64_t count, T* coarse) {
  const Index3 fine_dims = lattice.samples(level);
  const Index3 dims = lattice.samples(level + 1);
  const auto tap = [&](int axis, std::int64_t i) {
    LowPassTap t = lowPassTap(lattice, level, axis, i);
    if (filter == format::Filter::kSubsample) t.filtered = false;
    return t;
  };
  std::vector<LowPassTap> x_taps;
  for (std::int64_t i = 0; i < dims.x; ++i) x_taps.push_back(tap(0, i));

  const auto width = static_cast<std::size_t>(dims.x);
  std::vector<Sum<T>> row(width), row_sum(width), slice_sum(width);
  for (std::int64_t k = first; k < first + count; ++k) {
    const LowPassTap tz = tap(2, k);
    for (std::int64_t j = 0; j < dims.y; ++j) {
      const LowPassTap ty = tap(1, j);
      const int reach_z = tz.filtered ? 1 : 0, reach_y = ty.filtered ? 1 : 0;
      std::fill(slice_sum.begin(), slice_sum.end(), Sum<T>{0});
      for (int dz = -reach_z; dz <= reach_z; ++dz) {
        std::fill(row_sum.begin(), row_sum.end(), Sum<T>{0});
        for (int dy = -reach_y; dy <= reach_y; ++dy) {
          filterRow<T>(x_taps,
                       fine + ((tz.center + dz) * fine_dims.y + ty.center + dy) * fine_dims.x,
                       row.data());
          const Sum<T> weight = reach_y == 1 && dy == 0 ? 2 : 1;
          for (std::size_t i = 0; i < width; ++i) row_sum[i] += weight * row[i];
        }
        const Sum<T> weight = reach_z == 1 && dz == 0 ? 2 : 1;
        for (std::size_t i = 0; i < width; ++i) slice_sum[i] += weight * row_sum[i];
      }
      T* out = coarse + ((k - first) * dims.y + j) * dims.x;
      for (std::size_t i = 0; i < width; ++i)
        out[i] = divideRounding<T>(slice_sum[i], reach_z + reach_y + (x_taps[i].filtered ? 1 : 0));
    }
  }
}

#define ISOBRICK_INSTANTIATE(T)                                                               \
  template void lowPassSlices<T>(const Lattice&, int, format::Filter, const T*, std::int64_t, \
                                 std::int64_t, T*);
ISOBRICK_FOR_EACH_VOXEL_TYPE(ISOBRICK_INSTANTIATE)
#undef ISOBRICK_INSTANTIATE

}  // namespace isobrick
