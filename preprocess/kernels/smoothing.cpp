#include "isobrick/preprocess/kernels/smoothing.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <type_traits>

#include "isobrick/storage/voxel_type.h"

namespace isobrick {
namespace {

constexpr std::size_t kSamplesAtATime = 16;  // samples whose sums stay in registers

// Of the samples from `at` on. Known at compile time, kCount makes vectors of the inner loops.
template <typename T, std::size_t kCount>
void smoothRun(const T* center, std::span<const T* const> pairs, const float* weights,
               std::size_t at, float* out) {
  float sum[kCount] = {};
  for (std::size_t k = 0; 2 * k < pairs.size(); ++k) {
    const T* const before = pairs[2 * k] + at;
    const T* const after = pairs[2 * k + 1] + at;
    const float weight = weights[k];
    for (std::size_t i = 0; i < kCount; ++i) {
      float difference = (static_cast<float>(before[i]) + static_cast<float>(after[i])) -
                         2.0f * static_cast<float>(center[at + i]);
      if constexpr (std::is_floating_point_v<T>)
        difference = std::abs(difference) <= std::numeric_limits<float>::max() ? difference : 0.0f;
      sum[i] += weight * difference;
    }
  }
  for (std::size_t i = 0; i < kCount; ++i)
    out[at + i] = static_cast<float>(center[at + i]) + sum[i];
}

}  // namespace

std::vector<float> smoothingWeights(double sigma) {
  const auto reach = static_cast<std::size_t>(std::max(1.0, std::ceil(2.5 * sigma)));
  std::vector<double> gaussian(2 * reach + 1);  // from -reach to reach
  double sum = 0;
  for (std::size_t i = 0; i < gaussian.size(); ++i) {
    const double x = (static_cast<double>(i) - static_cast<double>(reach)) / sigma;
    sum += gaussian[i] = std::exp(-x * x / 2);
  }
  for (double& weight : gaussian) weight /= sum;
  std::vector<float> weights;
  for (std::size_t distance = 1; distance <= 2 * reach; ++distance) {
    double weight = distance <= reach ? 2 * gaussian[reach + distance] : 0;
    for (std::size_t i = distance; i < gaussian.size(); ++i)
      weight -= gaussian[i] * gaussian[i - distance];
    weights.push_back(static_cast<float>(weight));
  }
  return weights;
}

template <typename T>
void smoothAcross(const T* center, std::span<const T* const> pairs, const float* weights,
                  std::size_t count, float* out) {
  std::size_t at = 0;
  for (; at + kSamplesAtATime <= count; at += kSamplesAtATime)
    smoothRun<T, kSamplesAtATime>(center, pairs, weights, at, out);
  for (; at < count; ++at) smoothRun<T, 1>(center, pairs, weights, at, out);
}

void smoothRow(const float* row, std::span<const float> weights, std::size_t count, float* out) {
  std::vector<const float*> pairs(2 * weights.size());
  // Samples [first, last) have `reach` pairs.
  const auto smooth = [&](std::size_t first, std::size_t last, std::size_t reach) {
    for (std::size_t k = 0; k < reach; ++k) {
      pairs[2 * k] = row + first - (k + 1);
      pairs[2 * k + 1] = row + first + (k + 1);
    }
    smoothAcross<float>(row + first, {pairs.data(), 2 * reach}, weights.data(), last - first,
                        out + first);
  };
  const std::size_t border = std::min(weights.size(), count / 2);
  for (std::size_t i = 0; i < border; ++i) smooth(i, i + 1, i);
  smooth(border, count - border, std::min(weights.size(), (count - 1) / 2));
  for (std::size_t i = count - border; i < count; ++i) smooth(i, i + 1, count - 1 - i);
}

#define ISOBRICK_SMOOTH_ACROSS(T)                                                               \
  template void smoothAcross<T>(const T*, std::span<const T* const>, const float*, std::size_t, \
                                float*);
ISOBRICK_FOR_EACH_VOXEL_TYPE(ISOBRICK_SMOOTH_ACROSS)
#undef ISOBRICK_SMOOTH_ACROSS

}  // namespace isobrick
