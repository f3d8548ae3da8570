// The CT-like head phantom, row by row. Private to phantom.cpp.
#pragma once

#include <span>

namespace isobrick {

// Values (HU + 1024) of the points (x[i], y, z), ascending in x. Coordinates are -1 .. 1 across the
// volume: x to the left, y to the back, z up. `voxel` is the edge of a voxel in these units: the
// width over which materials blend, as in a scanner. Thread-safe.
void headPhantomRow(std::span<const float> x, float y, float z, float voxel, float* out);

}  // namespace isobrick
