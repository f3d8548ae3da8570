#include "isobrick/extract/sinks/nearest_on_triangle.h"

#include <algorithm>
#include <array>
#include <glm/geometric.hpp>

namespace isobrick {
namespace {

glm::dvec3 nearestOnSegment(const glm::dvec3& point, const glm::dvec3& from, const glm::dvec3& to) {
  const glm::dvec3 along = to - from;
  const double square = glm::dot(along, along);
  const double share = square > 0.0 ? glm::dot(point - from, along) / square : 0.0;
  return from + std::clamp(share, 0.0, 1.0) * along;
}

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
  const auto squareTo = [&](const glm::dvec3& place) {
    return glm::dot(place - point, place - point);
  };
  return *std::ranges::min_element(on_sides, {}, squareTo);
}

}  // namespace

double squaredDistance(const glm::dvec3& point, const glm::dvec3& a, const glm::dvec3& b,
                       const glm::dvec3& c) {
  const glm::dvec3 away = point - nearestOnTriangle(point, a, b, c);
  return glm::dot(away, away);
}

}  // namespace isobrick
