#define HWY_WANT_AVX3_DL
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "isobrick/extract/kernels/field_bounds.cpp"
#include "isobrick/extract/kernels/field_bounds.h"

#include <hwy/foreach_target.h>  // must come before highway.h
#include <hwy/highway.h>

#include <algorithm>

#include "isobrick/storage/voxel_type.h"

// Loops that the compiler makes vectors of, on every target; the same operations in the same order.
HWY_BEFORE_NAMESPACE();
namespace isobrick {
namespace HWY_NAMESPACE {

constexpr std::int64_t kMostSamples = kMaxBrickCells / 2 + 2;

// Adds the shares of the lesser and of the greater of both values at samples [first, last]. Sums of
// shares are finite where sums of values may not be.
template <typename T>
void addSamples(const T* HWY_RESTRICT voxels, const T* HWY_RESTRICT samples, float share,
                std::int64_t first, std::int64_t last, float* HWY_RESTRICT least,
                float* HWY_RESTRICT greatest) {
  for (std::int64_t i = first; i <= last; ++i) {
    const auto a = static_cast<float>(voxels[2 * i]), b = static_cast<float>(samples[i]);
    least[i] += share * (b < a ? b : a);
    greatest[i] += share * (b < a ? a : b);
  }
}

// From means at samples to those at the voxels [first, last], the last not being a sample where it
// is odd.
void spread(const float* HWY_RESTRICT means, std::int64_t first, std::int64_t last,
            float* HWY_RESTRICT bound) {
  for (std::int64_t i = first / 2; 2 * i + 1 <= last; ++i) {
    bound[2 * i] = means[i];
    bound[2 * i + 1] = 0.5f * means[i] + 0.5f * means[i + 1];
  }
  if (last % 2 == 0) bound[last] = means[last / 2];
}

template <typename T>
void boundAll(const SampleRows<T>& around, const T* HWY_RESTRICT voxels, std::int64_t first,
              std::int64_t last, float* HWY_RESTRICT value, float* HWY_RESTRICT low,
              float* HWY_RESTRICT high) {
  for (std::int64_t x = first; x <= last; ++x) value[x] = static_cast<float>(voxels[x]);
  float least[kMostSamples], greatest[kMostSamples];
  const std::int64_t begin = first / 2, end = (last + 1) / 2;
  std::fill(least + begin, least + end + 1, 0.0f);
  std::fill(greatest + begin, greatest + end + 1, 0.0f);
  const float share = 1.0f / static_cast<float>(around.count);
  // An odd last voxel is a sample.
  const bool is_odd_last = last == around.last_voxel && last % 2 != 0;
  for (int row = 0; row < around.count; ++row) {
    addSamples(around.voxels[row], around.samples[row], share, begin, is_odd_last ? end - 1 : end,
               least, greatest);
    if (!is_odd_last) continue;
    const auto a = static_cast<float>(around.voxels[row][last]),
               b = static_cast<float>(around.samples[row][end]);
    least[end] += share * (b < a ? b : a);
    greatest[end] += share * (b < a ? a : b);
  }
  spread(least, first, is_odd_last ? last - 1 : last, low);
  spread(greatest, first, is_odd_last ? last - 1 : last, high);
  if (is_odd_last) {
    low[last] = least[end];
    high[last] = greatest[end];
  }
}

// Highway dispatches functions, not templates, so this is one for all voxel types: `around` is a
// SampleRows<T>, `voxels` are T.
void boundOfType(VoxelType type, const void* around, const void* voxels, std::int64_t first,
                 std::int64_t last, float* value, float* low, float* high) {
  visitVoxelType(type, [&](auto tag) {
    using T = typename decltype(tag)::Type;
    boundAll(*static_cast<const SampleRows<T>*>(around), static_cast<const T*>(voxels), first, last,
             value, low, high);
  });
}

}  // namespace HWY_NAMESPACE
}  // namespace isobrick
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace isobrick {

HWY_EXPORT(boundOfType);

template <typename T>
void boundField(const SampleRows<T>& around, const T* voxels, std::int64_t first, std::int64_t last,
                float* value, float* low, float* high) {
  HWY_DYNAMIC_DISPATCH(boundOfType)
  (voxelTypeOf<T>(), &around, voxels, first, last, value, low, high);
}

#define ISOBRICK_INSTANTIATE(T)                                                                   \
  template void boundField<T>(const SampleRows<T>&, const T*, std::int64_t, std::int64_t, float*, \
                              float*, float*);
ISOBRICK_FOR_EACH_VOXEL_TYPE(ISOBRICK_INSTANTIATE)
#undef ISOBRICK_INSTANTIATE

}  // namespace isobrick
#endif
