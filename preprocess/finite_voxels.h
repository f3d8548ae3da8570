// Voxels that are not finite: NaN and infinite ones.
#pragma once

#include <cstdint>
#include <optional>

#include "isobrick/preprocess/kernels/sample_block.h"
#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// Puts `nan_as` into the place of every such voxel of `box`, x fastest; without it throws Error
// that names the first. Returns how many of `counted` were replaced.
std::uint64_t makeFinite(float* voxels, const IndexBox& box, const IndexBox& counted,
                         std::optional<float> nan_as, const VolumeInfo& info);

// Throws the Error of makeFinite() if the block has such a voxel.
void requireFinite(const SampleBlock<float>& voxels, const VolumeInfo& info);

}  // namespace isobrick
