// Between which bounds the field of leaves of level 1 lies along a row of voxels (rule 15).
#pragma once

#include <cstdint>

#include "isobrick/extract/kernels/brick_rows.h"

namespace isobrick {

// What a row of voxels lies on or between of level 1, in a closed brick of both levels: one, two or
// four rows of samples. All is counted from the brick's first voxel or sample. T: the voxel type.
template <typename T>
struct SampleRows {
  const T* voxels[4];   // rows of level 0 at the samples: sample i sits at voxel 2 i,
  const T* samples[4];  // but the last of an even number of voxels, at the last
  int count = 0;
  std::int64_t last_voxel = 0;  // of a row; at most kMaxBrickCells
};

// Of the voxels [first, last] of the row `voxels`, `first` being even: their values, and the
// interpolants of the lesser and of the greater of both levels' samples, to the places of the same
// number.
template <typename T>
void boundField(const SampleRows<T>& around, const T* voxels, std::int64_t first, std::int64_t last,
                float* value, float* low, float* high);

}  // namespace isobrick
