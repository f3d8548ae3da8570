#include "isobrick/viewer/outline_ribbon.h"

#include <array>
#include <cmath>
#include <cstddef>
#include <glm/geometric.hpp>
#include <glm/trigonometric.hpp>
#include <glm/vec2.hpp>

namespace isobrick {

std::vector<glm::vec3> outlineRibbon(const SphereOutline& sphere, const PlacedCamera& camera,
                                     int width, int height, double reach) {
  const glm::dvec3 to_center = sphere.center - camera.eye;
  const double distance = glm::length(to_center);
  const double r = sphere.radius;
  if (!(r > 0.0) || !(camera.orthographic || distance > r)) return {};

  // The rays that graze the sphere touch it along a circle, nearer than the centre and smaller than
  // the sphere.
  const bool parallel = camera.orthographic;  // then the rays touch it along a great circle
  const glm::dvec3 axis = parallel ? camera.forward : to_center / distance;
  const glm::dvec3 middle = parallel ? to_center : to_center - axis * (r * r / distance);
  const double circle_radius = parallel ? r : r * std::sqrt(1.0 - (r / distance) * (r / distance));
  const glm::dvec3 helper = std::abs(glm::dot(axis, camera.up)) < 0.9 ? camera.up : camera.right;
  const glm::dvec3 u = glm::normalize(glm::cross(axis, helper));
  const glm::dvec3 v = glm::cross(axis, u);

  struct Point {
    glm::dvec2 pixel;
    glm::dvec2 across;  // unit, in pixels
    bool ahead;
  };
  constexpr int kSegments = 360;
  std::array<Point, kSegments> points;
  const glm::dvec2 half_size(0.5 * width, 0.5 * height);
  const auto toPixel = [&](const glm::dvec3& arm) {
    const double depth = parallel ? 1.0 : glm::dot(arm, camera.forward);
    return half_size * glm::dvec2(glm::dot(arm, camera.right) / (depth * camera.half_width),
                                  glm::dot(arm, camera.up) / (depth * camera.half_height));
  };
  for (int i = 0; i < kSegments; ++i) {
    const double angle = glm::radians(360.0 * i / kSegments);
    const glm::dvec3 radial = u * std::cos(angle) + v * std::sin(angle);
    const glm::dvec3 tangent = v * std::cos(angle) - u * std::sin(angle);
    const glm::dvec3 arm = middle + circle_radius * radial;
    Point& point = points[static_cast<std::size_t>(i)];
    point.ahead = parallel || glm::dot(arm, camera.forward) > 1e-3 * distance;
    if (!point.ahead) continue;
    point.pixel = toPixel(arm);
    const glm::dvec2 along = toPixel(arm + 1e-4 * circle_radius * tangent) - point.pixel;
    point.across = glm::normalize(glm::dvec2(-along.y, along.x));
  }

  std::vector<glm::vec3> ribbon;
  const auto corner = [&](const Point& point, double side) {
    return glm::vec3(glm::vec2((point.pixel + side * reach * point.across) / half_size),
                     side * reach);
  };
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Point& a = points[i];
    const Point& b = points[(i + 1) % points.size()];
    if (!a.ahead || !b.ahead) continue;
    for (const glm::vec3& place : {corner(a, -1.0), corner(b, -1.0), corner(b, 1.0),
                                   corner(a, -1.0), corner(b, 1.0), corner(a, 1.0)}) {
      ribbon.push_back(place);
    }
  }
  return ribbon;
}

}  // namespace isobrick
