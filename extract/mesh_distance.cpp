#include "isobrick/extract/mesh_distance.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <limits>

#include "isobrick/extract/sinks/nearest_parts.h"
#include "isobrick/extract/triangle_tree.h"
#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

std::size_t cornerAt(const std::array<std::uint32_t, 3>& triangle, std::uint32_t vertex) {
  return static_cast<std::size_t>(std::ranges::find(triangle, vertex) - triangle.begin());
}

// Of a triangle, by twice its area.
glm::dvec3 faceNormal(const std::array<glm::dvec3, 3>& p) {
  return glm::cross(p[1] - p[0], p[2] - p[0]);
}

glm::dvec3 unitOf(const glm::dvec3& v) {
  const double length = glm::length(v);
  return length > 0 ? v / length : glm::dvec3(0.0);
}

}  // namespace

MeshDistance::MeshDistance(IndexedMesh mesh) {
  if (mesh.triangles.empty())
    throw Error("a mesh without triangles has no distance; give another one");
  glm::dvec3 lower(std::numeric_limits<double>::infinity()), upper = -lower;
  for (const glm::dvec3& position : mesh.positions) {
    lower = glm::min(lower, position);
    upper = glm::max(upper, position);
  }
  middle_ = (lower + upper) / 2.0;
  for (const glm::dvec3& position : mesh.positions) positions_.emplace_back(position - middle_);
  for (std::size_t i = 0; i + 2 < mesh.triangles.size(); i += 3)
    triangles_.push_back({mesh.triangles[i], mesh.triangles[i + 1], mesh.triangles[i + 2]});
  mesh = {};

  first_.assign(positions_.size() + 1, 0);
  for (const Triangle& triangle : triangles_)
    for (const std::uint32_t v : triangle) ++first_[v];
  std::uint32_t sum = 0;
  for (std::uint32_t& first : first_) first = sum += first;
  at_vertices_.resize(sum);
  for (auto t = static_cast<std::uint32_t>(triangles_.size()); t-- > 0;)
    for (const std::uint32_t v : triangles_[t]) at_vertices_[--first_[v]] = t;
  tree_ = std::make_unique<const TriangleTree>(positions_, triangles_);
  is_closed_ = findClosed();
}

MeshDistance::~MeshDistance() = default;

std::span<const std::uint32_t> MeshDistance::trianglesAt(std::uint32_t vertex) const {
  return std::span(at_vertices_).subspan(first_[vertex], first_[vertex + 1] - first_[vertex]);
}

bool MeshDistance::findClosed() const {
  const auto hasEdge = [&](const Triangle& triangle, std::uint32_t from, std::uint32_t to) {
    const std::size_t at = cornerAt(triangle, from);
    return at < 3 && triangle[(at + 1) % 3] == to;
  };
  return std::ranges::all_of(triangles_, [&](const Triangle& triangle) {
    for (std::size_t i = 0; i < 3; ++i) {
      const std::uint32_t from = triangle[i], to = triangle[(i + 1) % 3];
      const auto count = [&](std::uint32_t a, std::uint32_t b) {
        return std::ranges::count_if(trianglesAt(from),
                                     [&](std::uint32_t t) { return hasEdge(triangles_[t], a, b); });
      };
      if (count(from, to) != 1 || count(to, from) != 1) return false;
    }
    return true;
  });
}

double MeshDistance::signOf(const glm::dvec3& point, std::uint32_t nearest) const {
  constexpr double kOnEdge = 1e-6;
  const auto pointsOf = [&](const Triangle& t) {
    return std::array<glm::dvec3, 3>{positions_[t[0]], positions_[t[1]], positions_[t[2]]};
  };
  const Triangle& triangle = triangles_[nearest];
  const std::array<glm::dvec3, 3> p = pointsOf(triangle);
  const glm::dvec3 foot = nearestOnTriangle(point, p[0], p[1], p[2]);
  const glm::dvec3 normal = faceNormal(p);
  const double area = glm::dot(normal, normal);
  // Corners whose share in the foot is not 0: one, the ends of an edge, or all.
  std::vector<std::uint32_t> feature;
  for (std::size_t i = 0; i < 3; ++i) {
    const glm::dvec3 opposite = glm::cross(p[(i + 2) % 3] - p[(i + 1) % 3], foot - p[(i + 1) % 3]);
    if (glm::dot(opposite, normal) > kOnEdge * area) feature.push_back(triangle[i]);
  }
  glm::dvec3 outward(0.0);
  if (feature.size() == 3 || feature.empty()) {
    outward = normal;
  } else {
    for (const std::uint32_t t : trianglesAt(feature[0])) {
      const Triangle& other = triangles_[t];
      if (feature.size() == 2 && cornerAt(other, feature[1]) == 3) continue;
      const std::array<glm::dvec3, 3> q = pointsOf(other);
      const std::size_t at = cornerAt(other, feature[0]);
      const glm::dvec3 u = unitOf(q[(at + 1) % 3] - q[at]), v = unitOf(q[(at + 2) % 3] - q[at]);
      const double angle = feature.size() == 2 ? 1 : std::acos(std::clamp(glm::dot(u, v), -1., 1.));
      outward += angle * unitOf(faceNormal(q));
    }
  }
  return glm::dot(point - foot, outward) < 0 ? -1 : 1;
}

void MeshDistance::evaluate(std::span<const glm::dvec3> world, std::span<const glm::vec3>,
                            std::span<double> values) const {
  std::uint32_t nearest = 0;
  for (std::size_t i = 0; i < world.size(); ++i) {
    const glm::dvec3 point = world[i] - middle_;
    const double distance = std::sqrt(tree_->squaredDistance(point, nearest));
    values[i] = is_closed_ ? signOf(point, nearest) * distance : distance;
  }
}

}  // namespace isobrick
