// The nearest point of a mesh.
#pragma once

#include <glm/vec3.hpp>
#include <vector>

#include "tools/bench/plain_mesh.h"

namespace isobrick {

// A hierarchy of boxes over the triangles of a mesh, for millions of them: the triangles in the
// order of a space-filling curve, a box for each kFanout neighbours, a box for each kFanout of
// those boxes, and so on. Nothing points anywhere, so it is built in one pass for each level.
// (CGAL and Embree answer the same question, and would be one more thing to install for it.)
//
// Refers to the mesh, which outlives it. Any number of threads may ask.
class TriangleTree {
 public:
  // Uses the calling TBB arena. A mesh without triangles is further away than anything.
  explicit TriangleTree(const PlainMesh& mesh);

  // A caller's memory between questions: near points have near answers.
  struct Hint {
    std::uint32_t triangle = 0;  // in the tree's order
  };
  // Distance from `point` to the mesh; infinite where that has no triangles.
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

// Squared distance between a point and a triangle, which may be a line or a point.
double squaredDistanceToTriangle(const glm::dvec3& point, const glm::dvec3& a, const glm::dvec3& b,
                                 const glm::dvec3& c);

}  // namespace isobrick
