// The triangle of a mesh that is nearest to a point.
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

namespace isobrick {

// Boxes around halves of the triangles, halves of these, and so on. Thread-safe once it is made.
class TriangleTree {
 public:
  using Triangle = std::array<std::uint32_t, 3>;  // numbers of positions

  // Refers to both. Uses the calling TBB arena.
  TriangleTree(std::span<const glm::vec3> positions, std::span<const Triangle> triangles);

  // The square of the distance; infinite without triangles. `hint` is a triangle, and becomes the
  // nearest one: near points have near results.
  double squaredDistance(const glm::dvec3& point, std::uint32_t& hint) const;

 private:
  void build(std::size_t node, std::span<std::uint32_t> triangles);
  double squaredTo(const glm::dvec3& point, std::uint32_t triangle) const;
  double squaredToBox(const glm::dvec3& point, std::size_t node) const;
  void search(std::size_t node, std::span<const std::uint32_t> triangles, const glm::dvec3& point,
              double& nearest, std::uint32_t& hint) const;

  struct Box {
    glm::vec3 lower, upper;
  };
  const std::span<const glm::vec3> positions_;
  const std::span<const Triangle> triangles_;
  std::vector<std::uint32_t> order_;
  std::vector<Box> boxes_;  // the children of a node are 2n and 2n + 1
};

}  // namespace isobrick
