// The triangles of a brick, from the bits and numbers of its rows.
#pragma once

#include "isobrick/extract/kernels/brick_rows.h"

namespace isobrick {

// The offsets from the numbers of a brick's crossings along each axis to vertex numbers. Arithmetic
// is modulo 2^32, also in BrickRows::numbers and first_numbers of foreign sides.
using FirstVertices = std::array<std::uint32_t, 3>;

// Those of a brick whose own crossings are numbered from `first_vertex` on.
inline FirstVertices firstVertices(const BrickRows& rows, std::uint32_t first_vertex) {
  return {first_vertex, first_vertex + rows.crossings[0],
          first_vertex + rows.crossings[0] + rows.crossings[1]};
}

// Writes the 3 * rows.triangles vertex numbers that numberRows() counted, cells by k, j, i, and
// nothing beyond. `mirrored` turns every triangle round.
void makeTriangles(const BrickRows& rows, const FirstVertices& first, bool mirrored,
                   std::uint32_t* triangles);

}  // namespace isobrick
