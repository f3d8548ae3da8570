#include "isobrick/viewer/render_camera.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/trigonometric.hpp>
#include <limits>

#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

bool isEmpty(const RenderBox& box) {
  return !(box.lower.x <= box.upper.x && box.lower.y <= box.upper.y && box.lower.z <= box.upper.z);
}

void placeLookAt(const LookAtCamera& look_at, PlacedCamera& camera) {
  camera.eye = look_at.eye;
  camera.forward = glm::normalize(look_at.target - look_at.eye);
  const glm::dvec3 right = glm::cross(camera.forward, glm::normalize(look_at.up));
  constexpr double kLeastSine = 1e-6;  // of the angle between up and the view
  if (!(glm::length(right) > kLeastSine) || !std::isfinite(glm::length(look_at.eye))) {
    throw Error(
        "cannot render: the camera's eye and target coincide or its up direction is parallel to "
        "the view; move the eye or choose another up direction");
  }
  camera.right = glm::normalize(right);
  camera.up = glm::cross(camera.right, camera.forward);
}

void turnOrbit(const OrbitCamera& orbit, PlacedCamera& camera) {
  const glm::dvec3 axis = glm::normalize(orbit.up);
  if (!std::isfinite(axis.x + axis.y + axis.z + orbit.azimuth + orbit.elevation)) {
    throw Error("cannot render: the camera's up direction is zero or an angle is not a number");
  }
  const bool axis_is_y = std::abs(axis.y) > 0.9;
  const glm::dvec3 ahead =
      axis_is_y ? glm::dvec3(0.0, 0.0, -std::copysign(1.0, axis.y)) : glm::dvec3(0.0, 1.0, 0.0);
  const glm::dvec3 front = glm::normalize(ahead - axis * glm::dot(ahead, axis));
  const glm::dvec3 side = glm::cross(front, axis);
  const double azimuth = glm::radians(orbit.azimuth);
  const double elevation = glm::radians(orbit.elevation);
  const glm::dvec3 outward = side * std::sin(azimuth) - front * std::cos(azimuth);
  // `up` is the derivative of the view by the elevation: defined even straight from above.
  camera.forward = -(outward * std::cos(elevation) + axis * std::sin(elevation));
  camera.up = axis * std::cos(elevation) - outward * std::sin(elevation);
  camera.right = glm::cross(camera.forward, camera.up);
}

// Moves the eye, without turning it, to where the points just fill the picture but for a margin:
// in the middle of both directions and touching the border in one.
template <typename Point>
void fitPoints(std::span<const Point> points, PlacedCamera& camera) {
  constexpr double kMargin = 1.06;
  const double half_width = camera.half_width / kMargin;
  const double half_height = camera.half_height / kMargin;
  // A point (x, y, z) along right, up and forward is left of the right border of an eye at (a, b,
  // c) where x - a <= half_width * (z - c); so only the greatest x - half_width * z of all points
  // matters there, and likewise at the three other borders.
  constexpr double kLeast = -std::numeric_limits<double>::infinity();
  double right = kLeast, left = kLeast, top = kLeast, bottom = kLeast, nearest = kLeast;
  for (const Point& point : points) {
    const glm::dvec3 p(point);
    const double x = glm::dot(p, camera.right);
    const double y = glm::dot(p, camera.up);
    const double z = glm::dot(p, camera.forward);
    right = std::max(right, x - half_width * z);
    left = std::max(left, -x - half_width * z);
    top = std::max(top, y - half_height * z);
    bottom = std::max(bottom, -y - half_height * z);
    nearest = std::max(nearest, -z);
  }
  double depth =
      std::min(-(right + left) / (2.0 * half_width), -(top + bottom) / (2.0 * half_height));
  // A point, or a line seen end on, can be approached without end.
  const double scale = std::max({1.0, std::abs(nearest), std::abs(right), std::abs(top)});
  if (-nearest - depth < 1e-9 * scale) depth = -nearest - 1.0;
  camera.eye = camera.right * (0.5 * (right - left)) + camera.up * (0.5 * (top - bottom)) +
               camera.forward * depth;
}

}  // namespace

PlacedCamera placeCamera(const RenderOptions& options, const RenderMesh& mesh) {
  PlacedCamera camera;
  camera.half_height = std::tan(0.5 * glm::radians(options.vertical_fov));
  camera.half_width = camera.half_height * options.width / options.height;
  if (options.look_at) {
    placeLookAt(*options.look_at, camera);
    return camera;
  }
  turnOrbit(options.orbit, camera);
  if (options.orbit.box && !isEmpty(*options.orbit.box)) {
    const std::array<glm::dvec3, 8> corners = cornersOf(
        WorldBox{glm::dvec3(options.orbit.box->lower), glm::dvec3(options.orbit.box->upper)});
    fitPoints(std::span<const glm::dvec3>(corners), camera);
  } else if (!mesh.positions.empty()) {
    fitPoints(mesh.positions, camera);
  }
  return camera;
}

RenderBox boundsOf(std::span<const glm::vec3> positions) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  RenderBox box{glm::vec3(kInfinity), glm::vec3(-kInfinity)};
  for (const glm::vec3& position : positions) {
    box.lower = glm::min(box.lower, position);
    box.upper = glm::max(box.upper, position);
  }
  return box;
}

}  // namespace isobrick
