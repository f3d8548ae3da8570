// The curvature part of a brick: coded bounds for its cells of level 1.
#pragma once

#include <cstdint>
#include <vector>

#include "preprocess/node_ranges.h"
#include "storage/brick_layout.h"

namespace isobrick {

// Three CurvatureCode coefficients for every node of a brick of level 0 (x fastest), each a bound
// over the range of the tile that holds the node. `samples` are the brick's own
// (layout.brickSampleBox), `tiles` the ranges of all tiles of level 0. Thread-safe.
template <typename T>
std::vector<std::uint8_t> brickCurvature(const BrickLayout& layout, const Index3& brick,
                                         const T* samples, const NodeRanges& tiles, double epsilon);

}  // namespace isobrick
