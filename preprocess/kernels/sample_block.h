// Samples of a box of one level, as they lie in a larger buffer.
#pragma once

#include <algorithm>

#include "isobrick/storage/brick_layout.h"

namespace isobrick {

// A view: the buffer belongs to another object and outlives it. Copy it freely.
template <typename T>
struct SampleBlock {
  const T* data = nullptr;                        // the sample at box.first
  IndexBox box;                                   // in samples of the level
  std::int64_t row_stride = 0, slice_stride = 0;  // in samples

  // A block that fills its buffer without gaps, x fastest.
  static SampleBlock dense(const T* data, const IndexBox& box) {
    return {data, box, box.count.x, box.count.x * box.count.y};
  }
  // The sample (box.first.x, y, z); y and z are indices of the level.
  const T* row(std::int64_t y, std::int64_t z) const {
    return data + (z - box.first.z) * slice_stride + (y - box.first.y) * row_stride;
  }
  const T& at(const Index3& i) const { return row(i.y, i.z)[i.x - box.first.x]; }
  // The part of it that `inner`, which lies within box, covers.
  SampleBlock part(const IndexBox& inner) const {
    return {&at(inner.first), inner, row_stride, slice_stride};
  }
};

// Copies the samples of `block` in `box`, which lies within both, to the dense `target`.
template <typename From, typename To>
void copyBox(const SampleBlock<From>& block, const IndexBox& box, To* target,
             const IndexBox& target_box) {
  for (std::int64_t z = box.first.z; z < box.end().z; ++z)
    for (std::int64_t y = box.first.y; y < box.end().y; ++y)
      std::copy_n(
          &block.at({box.first.x, y, z}), box.count.x,
          target + linearIndex(Index3(box.first.x, y, z) - target_box.first, target_box.count));
}

}  // namespace isobrick
