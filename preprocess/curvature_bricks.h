// The curvature part of a brick: coded bounds for its cells of level 1.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "isobrick/preprocess/kernels/sample_block.h"
#include "isobrick/storage/voxel_type.h"

namespace isobrick {

// Three CurvatureCode coefficients for every node of a brick of level 0 (x fastest), each a bound
// over the range of the tile that holds the node. `samples` cover at least the corners of the
// brick's cells (layout.brickCellBox), `tiles` are the ranges of the brick's own tiles
// (layout.brickTiles, x fastest) and hold their samples; epsilon is at least
// kLeastCurvatureEpsilon. `codes` is resized; its contents do not matter. Thread-safe.
template <typename T>
void brickCurvature(const BrickLayout& layout, const Index3& brick, const SampleBlock<T>& samples,
                    std::span<const ValueRange> tiles, double epsilon,
                    std::vector<std::uint8_t>& codes);

}  // namespace isobrick
