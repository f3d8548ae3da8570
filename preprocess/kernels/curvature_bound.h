// The bounds of curvature that a brick stores: how far level 1 lies from level 0 (Eq. 2 of the
// paper asks for them; Point 4 of docs/ALGORITHM.md).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "isobrick/preprocess/kernels/sample_block.h"
#include "isobrick/storage/brick_layout.h"
#include "isobrick/storage/voxel_type.h"

namespace isobrick {

// kDeviationCoefficients codes (DeviationCode) for every block of a brick of level 0, x fastest.
// `samples` cover at least the corners of the brick's cells (layout.brickCellBox), `coarse` those
// of the cells of level 1 around them, and `tiles` are the ranges of the brick's own tiles
// (layout.brickTiles, x fastest) and hold all of these. Without `coarse`, as in a volume of one
// level, the codes are 0. Samples where the gradient of level 1 is below `epsilon` times the
// block's range per voxel do not count. `codes` is resized; its contents do not matter. It is left
// empty if the brick has nothing to gain: level 1 is more than half a voxel away in every block of
// several values, at each of these. Thread-safe.
template <typename T>
void brickCurvature(const BrickLayout& layout, const Index3& brick, const SampleBlock<T>& samples,
                    const SampleBlock<T>& coarse, std::span<const ValueRange> tiles, double epsilon,
                    std::vector<std::uint8_t>& codes);

}  // namespace isobrick
