// Crossings of edges with given ends: for edges that touch leaves of several levels.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>

#include "isobrick/extract/kernels/crossing.h"

namespace isobrick {

// An end of an edge: its value, and the gradient there in values per voxel.
struct EdgeEnd {
  float value = 0;
  glm::vec3 gradient{0.0f};
};

// An edge of a mesh.
struct CrossedEdge {
  std::uint32_t vertex = 0;  // whose place its crossing takes
  int axis = 0;
  glm::vec3 begin{0.0f};  // in voxels, from the origin of positions
  float end = 0;          // its coordinate along the axis
};

// The position and the unit normal of a crossing.
struct EdgeCrossing {
  glm::vec3 position;
  glm::vec3 normal;
};
// One of the ends is inside.
inline EdgeCrossing makeEdgeCrossing(const WorldFrame& frame, float isovalue,
                                     const CrossedEdge& edge, const EdgeEnd& low,
                                     const EdgeEnd& high, const CrossingBounds& bounds = {}) {
  const float t = crossingParameter(isovalue, low.value, high.value, bounds);
  EdgeCrossing made{edge.begin, {}};
  made.position[edge.axis] = crossingCoordinate(edge.end, edge.end - edge.begin[edge.axis], t);
  made.normal =
      frame.normal(gradientAt(low.gradient, high.gradient, t), edge.axis, low.value >= isovalue);
  return made;
}

// Edges that wait until there are enough for the vector lanes.
struct EdgeQueue {
  static constexpr std::size_t kMost = 64;

  std::size_t count = 0;
  std::array<CrossedEdge, kMost> edges;
  // Written number by number where they lie: returned in registers, they would be put together in
  // memory, and the next load of them would wait.
  std::array<EdgeEnd, kMost> low, high;
  std::array<float, kMost> least, most;  // CrossingBounds

  // Makes the crossings of all, with the bits of makeEdgeCrossing(), puts them to positions[vertex]
  // and normals[vertex], and is empty then.
  void make(const WorldFrame& frame, float isovalue, glm::vec3* positions, glm::vec3* normals);
};

}  // namespace isobrick
