// Marching cubes with consistent faces: which edges of a cell make which triangles.
#pragma once

#include <array>
#include <cstdint>

#include "isobrick/extract/kernels/contour.h"

namespace isobrick {

// One of the 256 sign patterns of a cell. Bit c of the pattern is set if corner c is inside.
struct MarchingCubesCase {
  std::uint8_t triangle_count = 0;
  std::array<std::uint8_t, 36> edges{};  // three edges a triangle
};

// Made by the generator in marching_cubes_table.cpp at the first call. Every loop of n points gives
// n - 2 triangles, and no triangle side joins two points of one cell face unless it is part of the
// contour on that face (rule 10): a neighbour could have the same side, and the edge would be used
// four times. No two triangles of a pattern cross, wherever the crossings lie on their edges (rule
// 11).
const std::array<MarchingCubesCase, 256>& marchingCubesTable();

}  // namespace isobrick
