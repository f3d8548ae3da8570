// The nearest point of a mesh.
#pragma once

#include <glm/vec3.hpp>
#include <vector>

#include "tools/bench/plain_mesh.h"

namespace isobrick {

inline glm::vec3 cornerOf(const PlainMesh& mesh, std::uint32_t vertex) {
  const auto& p = mesh.positions[vertex];
  return {p[0], p[1], p[2]};
}

// A hierarchy of boxes over the triangles of a mesh, for millions of them: the triangles in the
// order of a space-filling curve, a box for each kFanout neighbours, a box for each kFanout of
// those boxes, and so on. There are no pointers, so it is built in one pass for each level. (CGAL
// and Embree do the same, and would be one more dependency.)
//
// Refers to the mesh, which outlives it. Any number of threads may use it.
class TriangleTree {
 public:
  // Uses the calling TBB arena. A mesh without triangles is further away than anything.
  explicit TriangleTree(const PlainMesh& mesh);

  // A caller's memory between calls: near points have near results.
  struct Hint {
    std::uint32_t triangle = 0;  // in the tree's order
  };
  // Distance from `point` to the mesh; infinite if that has no triangles.
  double distance(const glm::dvec3& point, Hint& hint) const;

 private:
  static constexpr std::size_t kFanout = 4;
  struct Box {
    glm::vec3 lower, upper;
  };
  double squaredTo(const glm::dvec3& point, std::uint32_t triangle) const;

  const PlainMesh& mesh_;
  std::vector<std::uint32_t> order_;     // triangles along the curve
  std::vector<std::vector<Box>> boxes_;  // of kFanout triangles, of kFanout^2, ...; one in the last
};

}  // namespace isobrick
