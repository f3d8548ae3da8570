// The samples of one brick, with gradients.
#pragma once

#include <bit>
#include <vector>

#include "isobrick/extract/kernels/edge_crossings.h"
#include "isobrick/storage/brick_layout.h"

namespace isobrick {

// Reads samples of `level` by their index in the level. Borrowed memory: valid while the brick is
// held. T: the voxel type.
template <typename T>
class SampleView {
 public:
  SampleView() = default;
  SampleView(const Lattice& lattice, int level, const IndexBox& box, const T* data)
      : data_(data), box_(box), stride_{1, box.count.x, box.count.x * box.count.y} {
    for (int axis = 0; axis < 3; ++axis) {
      auto& taps = taps_[axis];
      taps.resize(static_cast<std::size_t>(box.count[axis]));
      for (std::int64_t i = 0; i < box.count[axis]; ++i) {
        // At the border of the volume the difference is one-sided. Elsewhere a brick's own corners
        // always have both neighbours in the apron; no gradient is taken in the apron itself.
        const std::int64_t low = i > 0 ? i - 1 : i;
        const std::int64_t high = i + 1 < box.count[axis] ? i + 1 : i;
        const auto distance =
            static_cast<float>(lattice.position(level, axis, box.first[axis] + high) -
                               lattice.position(level, axis, box.first[axis] + low));
        const bool is_power = std::has_single_bit(static_cast<std::uint64_t>(distance));
        taps[static_cast<std::size_t>(i)] = {(low - i) * stride_[axis], (high - i) * stride_[axis],
                                             distance, is_power ? 1.0f / distance : 0.0f};
      }
    }
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
    for (int axis = 0; axis < 3; ++axis)
      (&out.gradient.x)[axis] = difference(at, taps_[axis][static_cast<std::size_t>(local[axis])]);
  }

 private:
  struct Tap {
    std::int64_t low = 0, high = 0;  // offsets from the sample
    float distance = 1;              // in voxels
    float inverse = 1;               // of the distance if that is exact, else 0
  };
  static float difference(const T* at, const Tap& tap) {
    const float values = static_cast<float>(at[tap.high]) - static_cast<float>(at[tap.low]);
    return tap.inverse != 0 ? values * tap.inverse : values / tap.distance;
  }
  const T* data_ = nullptr;
  IndexBox box_;
  std::int64_t stride_[3] = {0, 0, 0};
  std::vector<Tap> taps_[3];
};

}  // namespace isobrick
