#include "isobrick/viewer/state/view_camera.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/trigonometric.hpp>
#include <limits>

namespace isobrick {
namespace {

constexpr double kMargin = 1.06;  // around what is framed

PlacedCamera turned(const ViewCamera& camera) {
  const double azimuth = glm::radians(camera.azimuth);
  const double elevation = glm::radians(camera.elevation);
  const glm::dvec3 outward(std::sin(azimuth), -std::cos(azimuth), 0.0);
  const glm::dvec3 axis(0.0, 0.0, 1.0);
  PlacedCamera placed;
  placed.forward = -(outward * std::cos(elevation) + axis * std::sin(elevation));
  // The derivative of the view by the elevation: defined even straight from above.
  placed.up = axis * std::cos(elevation) - outward * std::sin(elevation);
  placed.right = glm::cross(placed.forward, placed.up);
  return placed;
}

double halfHeight(const ViewCamera& camera) {
  return std::tan(0.5 * glm::radians(camera.vertical_fov));
}

double wrapped(double degrees) { return degrees - 360.0 * std::round(degrees / 360.0); }

}  // namespace

PlacedCamera placeCamera(const ViewCamera& camera, double aspect) {
  PlacedCamera placed = turned(camera);
  placed.eye = camera.pivot - camera.distance * placed.forward;
  placed.half_height = halfHeight(camera) * (camera.orthographic ? camera.distance : 1.0);
  placed.half_width = placed.half_height * aspect;
  placed.orthographic = camera.orthographic;
  return placed;
}

ViewCamera lookingAt(const glm::dvec3& eye, const glm::dvec3& target) {
  const glm::dvec3 outward = glm::normalize(eye - target);
  ViewCamera camera;
  camera.pivot = target;
  camera.distance = glm::distance(eye, target);
  camera.elevation = glm::degrees(std::asin(std::clamp(outward.z, -1.0, 1.0)));
  const bool is_vertical = outward.x == 0.0 && outward.y == 0.0;
  camera.azimuth = !is_vertical      ? glm::degrees(std::atan2(outward.x, -outward.y))
                   : outward.z > 0.0 ? 0.0
                                     : 180.0;
  return camera;
}

ViewCamera framed(const ViewCamera& camera, const WorldBox& box, double aspect) {
  if (box.empty()) return camera;
  ViewCamera result = camera;
  result.pivot = box.center();
  const PlacedCamera axes = turned(camera);
  const double half_height = halfHeight(camera) / kMargin;
  const double half_width = half_height * aspect;
  double distance = 0.0;
  for (const glm::dvec3& corner : cornersOf(box)) {
    const glm::dvec3 arm = corner - result.pivot;
    const double aside = std::max(std::abs(glm::dot(arm, axes.right)) / half_width,
                                  std::abs(glm::dot(arm, axes.up)) / half_height);
    distance =
        std::max(distance, aside - (camera.orthographic ? 0.0 : glm::dot(arm, axes.forward)));
  }
  if (distance > 0.0) result.distance = distance;
  return result;
}

CameraFit::CameraFit(const ViewCamera& camera, double aspect)
    : camera_(camera),
      axes_(turned(camera)),
      half_width_(halfHeight(camera) * aspect / kMargin),
      half_height_(halfHeight(camera) / kMargin),
      beyond_(-std::numeric_limits<double>::infinity()),
      nearest_(-std::numeric_limits<double>::infinity()) {}

// A point (x, y, z) along right, up and forward is left of the right border of an eye at (a, b, c)
// if x - a <= half_width * (z - c); so only the greatest x - half_width * z of all points matters
// there, and likewise at the three other borders.
void CameraFit::include(const glm::dvec3& point) {
  const double x = glm::dot(point, axes_.right);
  const double y = glm::dot(point, axes_.up);
  const double z = glm::dot(point, axes_.forward);
  const double across = half_width_ * z, along = half_height_ * z;
  beyond_ = glm::max(beyond_, glm::dvec4(x - across, -x - across, y - along, -y - along));
  nearest_ = std::max(nearest_, -z);
  box_.include(point);
}

ViewCamera CameraFit::fitted() const {
  if (box_.empty()) return camera_;
  const auto [right, left, top, bottom] = std::array{beyond_.x, beyond_.y, beyond_.z, beyond_.w};
  double depth =
      std::min(-(right + left) / (2.0 * half_width_), -(top + bottom) / (2.0 * half_height_));
  // A point, or a line seen end on, can be approached without end.
  const double scale = std::max({1.0, std::abs(nearest_), std::abs(right), std::abs(top)});
  if (-nearest_ - depth < 1e-9 * scale) depth = -nearest_ - 1.0;
  const glm::dvec3 eye = axes_.right * (0.5 * (right - left)) + axes_.up * (0.5 * (top - bottom)) +
                         axes_.forward * depth;
  ViewCamera result = camera_;
  result.distance = glm::dot(box_.center() - eye, axes_.forward);
  result.pivot = eye + result.distance * axes_.forward;
  return result;
}

ViewCamera orbited(const ViewCamera& camera, double azimuth_degrees, double elevation_degrees) {
  ViewCamera result = camera;
  result.azimuth = wrapped(camera.azimuth + azimuth_degrees);
  result.elevation = std::clamp(camera.elevation + elevation_degrees, -90.0, 90.0);
  return result;
}

ViewCamera panned(const ViewCamera& camera, const glm::dvec2& shift, double aspect) {
  const PlacedCamera axes = turned(camera);
  const double half_height = halfHeight(camera) * camera.distance;
  ViewCamera result = camera;
  result.pivot -= axes.right * (shift.x * half_height * aspect) + axes.up * (shift.y * half_height);
  return result;
}

ViewCamera zoomed(const ViewCamera& camera, double factor, const glm::dvec2& cursor, double aspect,
                  double least, double greatest) {
  ViewCamera result = camera;
  result.distance = std::clamp(camera.distance * factor, least, greatest);
  const double kept = result.distance / camera.distance;
  const PlacedCamera axes = turned(camera);
  const double half_height = halfHeight(camera) * camera.distance;
  const glm::dvec3 under = camera.pivot + axes.right * (cursor.x * half_height * aspect) +
                           axes.up * (cursor.y * half_height);
  result.pivot = under + (camera.pivot - under) * kept;
  return result;
}

ViewCamera lookedAround(const ViewCamera& camera, double azimuth_degrees,
                        double elevation_degrees) {
  const glm::dvec3 eye = camera.pivot - camera.distance * turned(camera).forward;
  // Looking right is the same as orbiting to the left around the point in front.
  ViewCamera result = orbited(camera, -azimuth_degrees, -elevation_degrees);
  result.pivot = eye + result.distance * turned(result).forward;
  return result;
}

ViewCamera flown(const ViewCamera& camera, const glm::dvec3& right_up_forward) {
  const PlacedCamera axes = turned(camera);
  ViewCamera result = camera;
  result.pivot += axes.right * right_up_forward.x + axes.up * right_up_forward.y +
                  axes.forward * right_up_forward.z;
  return result;
}

ViewCamera turningAbout(const ViewCamera& camera, const glm::dvec3& pivot) {
  ViewCamera result = camera;
  result.pivot = pivot;
  return result;
}

ViewCamera alongAxis(const ViewCamera& camera, AxisView view) {
  // Azimuth and elevation, in the order of AxisView.
  constexpr std::array<std::array<double, 2>, 6> kDirections{
      {{0.0, 0.0}, {180.0, 0.0}, {90.0, 0.0}, {-90.0, 0.0}, {0.0, 90.0}, {0.0, -90.0}}};
  ViewCamera result = camera;
  const auto [azimuth, elevation] = kDirections[static_cast<std::size_t>(view)];
  result.azimuth = azimuth;
  result.elevation = elevation;
  return result;
}

}  // namespace isobrick
