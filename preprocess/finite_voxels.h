// Voxels that are not finite: NaN and infinite ones.
#pragma once

#include <cstdint>
#include <optional>

#include "isobrick/preprocess/kernels/sample_block.h"
#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// What becomes of them.
struct NotFinite {
  std::optional<float> nan_as;  // takes their place
  bool masks_nan = false;       // NaN stays, with the same bits everywhere: a voxel without data
};
// How many there were.
struct NotFiniteCounts {
  std::uint64_t replaced = 0, missing = 0;
};

// Does that to the voxels of `box`, x fastest, and adds those of `counted` to `counts`. Throws
// Error that names the first voxel for which there is no value.
void makeFinite(float* voxels, const IndexBox& box, const IndexBox& counted, const NotFinite& rule,
                const VolumeInfo& info, NotFiniteCounts& counts);

// Throws the Error of makeFinite() if the block has such a voxel.
void requireFinite(const SampleBlock<float>& voxels, const VolumeInfo& info);

}  // namespace isobrick
