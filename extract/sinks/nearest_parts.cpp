#include "isobrick/extract/sinks/nearest_parts.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <utility>

namespace isobrick {
namespace {

double squaredLength(const glm::dvec3& v) { return glm::dot(v, v); }

glm::dvec3 nearestOnSegment(const glm::dvec3& point, const glm::dvec3& from, const glm::dvec3& to) {
  const glm::dvec3 along = to - from;
  const double square = glm::dot(along, along);
  const double share = square > 0.0 ? glm::dot(point - from, along) / square : 0.0;
  return from + std::clamp(share, 0.0, 1.0) * along;
}

}  // namespace

glm::dvec3 nearestOnTriangle(const glm::dvec3& point, const glm::dvec3& a, const glm::dvec3& b,
                             const glm::dvec3& c) {
  const glm::dvec3 normal = glm::cross(b - a, c - a);
  const double square = glm::dot(normal, normal);
  const auto isLeftOf = [&](const glm::dvec3& from, const glm::dvec3& to) {
    return glm::dot(glm::cross(to - from, point - from), normal) >= 0.0;
  };
  if (square > 0.0 && isLeftOf(a, b) && isLeftOf(b, c) && isLeftOf(c, a))
    return point - glm::dot(point - a, normal) / square * normal;
  const std::array<glm::dvec3, 3> on_sides{
      nearestOnSegment(point, a, b), nearestOnSegment(point, b, c), nearestOnSegment(point, c, a)};
  return *std::ranges::min_element(
      on_sides, {}, [&](const glm::dvec3& place) { return squaredLength(place - point); });
}

double squaredDistance(const glm::dvec3& point, const glm::dvec3& a, const glm::dvec3& b,
                       const glm::dvec3& c) {
  return squaredLength(point - nearestOnTriangle(point, a, b, c));
}

NearestParts::NearestParts(std::vector<glm::dvec3> points, double reach, double cell_edge)
    : points_(std::move(points)), reach_(reach * cell_edge), nearest_(points_.size()) {}

void NearestParts::add(const MeshBatch& batch, const std::vector<glm::dvec3>& positions,
                       const std::vector<std::uint32_t>& parts, std::uint64_t first_part) {
  if (points_.empty() || batch.triangles.empty()) return;
  glm::dvec3 lower = positions[0], upper = positions[0];
  for (const glm::dvec3& position : positions) {
    lower = glm::min(lower, position);
    upper = glm::max(upper, position);
  }
  const double reach = std::ldexp(reach_, batch.level);
  std::vector<Nearest> known;
  {
    const std::lock_guard lock(mutex_);
    known = nearest_;
  }
  bool changed = false;
  for (std::size_t i = 0; i < points_.size(); ++i) {
    const glm::dvec3& point = points_[i];
    const double most = std::min(reach * reach, known[i].squared_distance);
    if (squaredLength(glm::max(glm::max(lower - point, point - upper), 0.0)) > most) continue;
    for (std::size_t t = 0; t < batch.triangles.size(); t += 3) {
      const std::uint32_t* const corners = batch.triangles.data() + t;
      const double squared = squaredDistance(point, positions[corners[0]], positions[corners[1]],
                                             positions[corners[2]]);
      const std::uint64_t part = first_part + parts[corners[0]];
      if (squared > reach * reach ||
          std::pair(squared, part) >= std::pair(known[i].squared_distance, known[i].part))
        continue;
      known[i] = {squared, part};
      changed = true;
    }
  }
  if (!changed) return;
  const std::lock_guard lock(mutex_);
  for (std::size_t i = 0; i < known.size(); ++i)
    if (std::pair(known[i].squared_distance, known[i].part) <
        std::pair(nearest_[i].squared_distance, nearest_[i].part))
      nearest_[i] = known[i];
}

}  // namespace isobrick
