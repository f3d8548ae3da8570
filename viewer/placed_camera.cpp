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

}  // namespace isobrick
