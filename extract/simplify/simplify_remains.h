// What a simplified batch keeps, so that it can be simplified again with its neighbours.
#pragma once

#include <cstddef>
#include <glm/vec3.hpp>
#include <type_traits>

#include "isobrick/extract/simplify/deviation.h"
#include "isobrick/extract/simplify/edge_costs.h"
#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// The finest triangles that became those of the batch, as they are seen from there.
struct SimplifyRemains {
  struct Vertex {
    Quadric quadric;             // about the position
    glm::vec3 normal_sum{0.0f};  // by area
  };
  RawVector<Vertex> vertices;
  RawVector<Deviation> triangles;
};
// Shares of a mesh hold them as they are.
static_assert(sizeof(SimplifyRemains::Vertex) == 14 * sizeof(float) &&
              std::is_trivially_copyable_v<SimplifyRemains::Vertex>);
static_assert(sizeof(Deviation) == 8 * sizeof(float) && std::is_trivially_copyable_v<Deviation>);

}  // namespace isobrick
