#include "isobrick/extract/triangle_tree.h"

#include <algorithm>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <limits>
#include <numeric>

#include "isobrick/extract/sinks/nearest_parts.h"
#include "isobrick/storage/isolated_loop.h"

namespace isobrick {
namespace {

constexpr std::size_t kLeafTriangles = 4;
constexpr std::size_t kParallelTriangles = 4096;

}  // namespace

TriangleTree::TriangleTree(std::span<const glm::vec3> positions,
                           std::span<const Triangle> triangles)
    : positions_(positions), triangles_(triangles), order_(triangles.size()) {
  std::iota(order_.begin(), order_.end(), 0u);
  std::size_t leaves = 1;
  while (leaves * kLeafTriangles < order_.size()) leaves *= 2;
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  boxes_.assign(2 * leaves, {glm::vec3(kInfinity), glm::vec3(-kInfinity)});
  if (!order_.empty()) build(1, order_);
}

void TriangleTree::build(std::size_t node, std::span<std::uint32_t> triangles) {
  Box& box = boxes_[node];
  for (const std::uint32_t triangle : triangles)
    for (const std::uint32_t vertex : triangles_[triangle]) {
      box.lower = glm::min(box.lower, positions_[vertex]);
      box.upper = glm::max(box.upper, positions_[vertex]);
    }
  if (triangles.size() <= kLeafTriangles) return;
  const glm::vec3 size = box.upper - box.lower;
  const int axis = size.x > size.y ? (size.x > size.z ? 0 : 2) : (size.y > size.z ? 1 : 2);
  const std::size_t half = triangles.size() / 2;
  const auto place = [&](std::uint32_t triangle) {
    const auto& [a, b, c] = triangles_[triangle];
    return positions_[a][axis] + positions_[b][axis] + positions_[c][axis];
  };
  std::nth_element(triangles.begin(), triangles.begin() + static_cast<std::ptrdiff_t>(half),
                   triangles.end(), [&](auto a, auto b) { return place(a) < place(b); });
  const auto buildChild = [&](std::size_t child) {
    build(2 * node + child, child == 0 ? triangles.first(half) : triangles.subspan(half));
  };
  if (triangles.size() > kParallelTriangles) {
    isolatedFor(std::size_t{0}, std::size_t{2}, buildChild);
  } else {
    buildChild(0);
    buildChild(1);
  }
}

double TriangleTree::squaredDistance(const glm::dvec3& point, std::uint32_t& hint) const {
  if (order_.empty()) return std::numeric_limits<double>::infinity();
  double nearest = squaredTo(point, hint);
  search(1, order_, point, nearest, hint);
  return nearest;
}

double TriangleTree::squaredTo(const glm::dvec3& point, std::uint32_t triangle) const {
  const auto& [a, b, c] = triangles_[triangle];
  return isobrick::squaredDistance(point, positions_[a], positions_[b], positions_[c]);
}

double TriangleTree::squaredToBox(const glm::dvec3& point, std::size_t node) const {
  const Box& box = boxes_[node];
  const glm::dvec3 outside = glm::max(
      glm::max(glm::dvec3(box.lower) - point, point - glm::dvec3(box.upper)), glm::dvec3(0));
  return glm::dot(outside, outside);
}

void TriangleTree::search(std::size_t node, std::span<const std::uint32_t> triangles,
                          const glm::dvec3& point, double& nearest, std::uint32_t& hint) const {
  if (triangles.size() <= kLeafTriangles) {
    for (const std::uint32_t triangle : triangles)
      if (const double squared = squaredTo(point, triangle); squared < nearest) {
        nearest = squared;
        hint = triangle;
      }
    return;
  }
  const std::size_t half = triangles.size() / 2;
  const double first = squaredToBox(point, 2 * node), second = squaredToBox(point, 2 * node + 1);
  for (const bool is_first : {first <= second, first > second})
    if ((is_first ? first : second) < nearest)
      search(is_first ? 2 * node : 2 * node + 1,
             is_first ? triangles.first(half) : triangles.subspan(half), point, nearest, hint);
}

}  // namespace isobrick
