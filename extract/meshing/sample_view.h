// The samples of one brick, with gradients.
#pragma once

#include <algorithm>
#include <cmath>
#include <type_traits>

#include "isobrick/extract/kernels/edge_crossings.h"
#include "isobrick/storage/brick_layout.h"

namespace isobrick {

// Reads samples of `level` by their index in the level. Borrowed memory: valid while the brick is
// held. T: the voxel type.
template <typename T>
class SampleView {
 public:
  SampleView(const Lattice& lattice, int level, const IndexBox& box, const T* data)
      : data_(data),
        box_(box),
        lattice_(&lattice),
        level_(level),
        stride_{1, box.count.x, box.count.x * box.count.y},
        inverse_(1.0f / static_cast<float>(std::int64_t{2} << level)) {
    for (int axis = 0; axis < 3; ++axis)
      regular_end_[axis] =
          std::min(box.count[axis] - 1, ((lattice.voxels()[axis] - 1) >> level) - box.first[axis]);
  }

  std::int64_t offset(const Index3& sample) const {
    return linearIndex(sample - box_.first, box_.count);
  }
  std::int64_t stride(int axis) const { return stride_[axis]; }
  const T* at(std::int64_t offset) const { return data_ + offset; }
  float value(const Index3& sample) const { return static_cast<float>(data_[offset(sample)]); }

  // Value and gradient to `out`: central differences, in values per voxel of level 0 (rule 12).
  void end(const Index3& sample, EdgeEnd& out) const {
    const Index3 local = sample - box_.first;
    const T* at = data_ + linearIndex(local, box_.count);
    out.value = static_cast<float>(*at);
    for (int axis = 0; axis < 3; ++axis) {
      const std::int64_t i = local[axis], step = stride_[axis];
      (&out.gradient.x)[axis] =
          i > 0 && i < regular_end_[axis]
              ? (static_cast<float>(at[step]) - static_cast<float>(at[-step])) * inverse_
              : borderDifference(at, axis, i);
      if constexpr (std::is_floating_point_v<T>)
        if (std::isnan((&out.gradient.x)[axis]))
          (&out.gradient.x)[axis] = differenceBesideMissing(at, axis, i);
    }
  }
  // True if a neighbour of the sample, from which its gradient comes, has no data.
  bool isBesideMissing(const Index3& sample) const {
    const Index3 local = sample - box_.first;
    const T* at = data_ + linearIndex(local, box_.count);
    for (int axis = 0; axis < 3; ++axis)
      if ((local[axis] > 0 && isMissing(at[-stride_[axis]])) ||
          (local[axis] + 1 < box_.count[axis] && isMissing(at[stride_[axis]])))
        return true;
    return false;
  }
  static bool isMissing(T value) { return std::isnan(static_cast<float>(value)); }

 private:
  // One-sided, as at the border of the volume; 0 if neither neighbour has data.
  float differenceBesideMissing(const T* at, int axis, std::int64_t i) const {
    for (const std::int64_t step : {-1, 1}) {
      if (i + step < 0 || i + step >= box_.count[axis]) continue;
      const float change = static_cast<float>(at[step * stride_[axis]]) - static_cast<float>(*at);
      if (std::isnan(change)) continue;
      return change /
             static_cast<float>(lattice_->position(level_, axis, box_.first[axis] + i + step) -
                                lattice_->position(level_, axis, box_.first[axis] + i));
    }
    return 0;
  }
  // At the border of the volume the difference is one-sided, or over a thin cell. Elsewhere a
  // brick's own corners always have both neighbours in the apron; no gradient is taken in the apron
  // itself.
  float borderDifference(const T* at, int axis, std::int64_t i) const {
    const std::int64_t low = i > 0 ? i - 1 : i;
    const std::int64_t high = i + 1 < box_.count[axis] ? i + 1 : i;
    const auto distance =
        static_cast<float>(lattice_->position(level_, axis, box_.first[axis] + high) -
                           lattice_->position(level_, axis, box_.first[axis] + low));
    return (static_cast<float>(at[(high - i) * stride_[axis]]) -
            static_cast<float>(at[(low - i) * stride_[axis]])) /
           distance;
  }

  const T* data_;
  IndexBox box_;
  const Lattice* lattice_;
  int level_;
  std::int64_t stride_[3];
  // Samples 1 .. regular_end_ - 1 of the box have neighbours on both sides, 2^level voxels away.
  std::int64_t regular_end_[3];
  float inverse_;  // of the distance between these
};

}  // namespace isobrick
