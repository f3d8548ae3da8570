// Chunks of one volume in the scene of another.
#pragma once

#include <glm/common.hpp>
#include <glm/matrix.hpp>

#include "isobrick/viewer/stream/surface_chunk.h"

namespace isobrick {

// The chunk in another lattice, to within 1/2048 of its steps. Points that were the same in two
// chunks are the same to the bit after it, as long as a chunk has less than 16384 steps. Its key
// stays: it is of the volume that it was made of.
inline void moveChunk(SurfaceChunk& chunk, const SceneLattice& from, const SceneLattice& to) {
  constexpr double kPerStep = 1024.0;  // places: a float holds 2^14 steps of them
  const glm::dmat3 to_steps = glm::inverse(to.matrix);
  const glm::dmat3 matrix = to_steps * from.matrix;
  const glm::dvec3 shift = to_steps * (from.origin - to.origin);
  const glm::dvec3 before = chunk.origin;
  chunk.origin = glm::round(matrix * before + shift);
  for (SurfaceVertex& vertex : chunk.vertices) {
    const glm::dvec3 point = matrix * (before + glm::dvec3(vertex.position)) + shift;
    vertex.position = glm::vec3(glm::round(point * kPerStep) / kPerStep - chunk.origin);
  }
  boundChunk(chunk);
}

}  // namespace isobrick
