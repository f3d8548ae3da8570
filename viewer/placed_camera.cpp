#include "isobrick/viewer/placed_camera.h"

#include <algorithm>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <limits>

namespace isobrick {

void WorldBox::include(const glm::dvec3& point) {
  lower = glm::min(lower, point);
  upper = glm::max(upper, point);
}

WorldBox emptyWorldBox() {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  return {glm::dvec3(kInfinity), glm::dvec3(-kInfinity)};
}

std::array<glm::dvec3, 8> cornersOf(const WorldBox& box) {
  std::array<glm::dvec3, 8> corners;
  for (unsigned i = 0; i < corners.size(); ++i) {
    corners[i] = {i & 1u ? box.upper.x : box.lower.x, i & 2u ? box.upper.y : box.lower.y,
                  i & 4u ? box.upper.z : box.lower.z};
  }
  return corners;
}

glm::dvec3 nearestPoint(const WorldBox& box, const glm::dvec3& point) {
  return glm::clamp(point, box.lower, box.upper);
}

DepthRange depthRangeOf(const WorldBox& box, const PlacedCamera& camera) {
  if (box.empty()) return {};
  double least = std::numeric_limits<double>::infinity();
  double greatest = -least;
  for (const glm::dvec3& corner : cornersOf(box)) {
    const double depth = glm::dot(corner - camera.eye, camera.forward);
    least = std::min(least, depth);
    greatest = std::max(greatest, depth);
  }
  if (camera.orthographic) {
    const double rim = std::max(1e-3 * (greatest - least), 1e-9);
    return {least - rim, greatest + rim};
  }
  if (greatest <= 0.0) return {};
  const double far = 1.001 * greatest;
  return {std::max(0.999 * least, 1e-4 * far), far};
}

DepthProjection reversedDepth(const DepthRange& range, bool orthographic) {
  const double scale = (orthographic ? 1.0 : range.near) / (range.far - range.near);
  return {scale, scale * range.far, orthographic};
}

PictureRay rayThrough(const PlacedCamera& camera, const glm::dvec2& place) {
  const glm::dvec3 aside =
      camera.right * (place.x * camera.half_width) + camera.up * (place.y * camera.half_height);
  if (camera.orthographic) return {camera.eye + aside, camera.forward};
  return {camera.eye, camera.forward + aside};
}

glm::dvec3 nearestPointOnBox(const WorldBox& box, const PictureRay& ray) {
  // Slabs first: the ray may enter the box.
  double enter = -std::numeric_limits<double>::infinity(), leave = -enter;
  for (int axis = 0; axis < 3; ++axis) {
    if (ray.direction[axis] == 0.0) {
      if (ray.origin[axis] < box.lower[axis] || ray.origin[axis] > box.upper[axis])
        leave = -std::numeric_limits<double>::infinity();
      continue;
    }
    const double a = (box.lower[axis] - ray.origin[axis]) / ray.direction[axis];
    const double b = (box.upper[axis] - ray.origin[axis]) / ray.direction[axis];
    enter = std::max(enter, std::min(a, b));
    leave = std::min(leave, std::max(a, b));
  }
  if (leave >= std::max(enter, 0.0)) return nearestPoint(box, ray.at(std::max(enter, 0.0)));
  // Beside it: the distance of the ray's points from the box is convex, so thirds close in.
  const double length = glm::length(ray.direction);
  const double reach =
      glm::length(box.center() - ray.origin) + 0.5 * glm::length(box.upper - box.lower);
  double low = 0.0, high = reach / length;
  const auto away = [&](double t) {
    return glm::distance(nearestPoint(box, ray.at(t)), ray.at(t));
  };
  for (int step = 0; step < 100; ++step) {
    const double a = low + (high - low) / 3.0, b = high - (high - low) / 3.0;
    (away(a) < away(b) ? high : low) = away(a) < away(b) ? b : a;
  }
  return nearestPoint(box, ray.at(0.5 * (low + high)));
}

}  // namespace isobrick
