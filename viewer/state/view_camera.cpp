#include "isobrick/viewer/state/view_camera.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/trigonometric.hpp>

namespace isobrick {
namespace {

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

ViewCamera framed(const ViewCamera& camera, const WorldBox& box, double aspect) {
  if (box.empty()) return camera;
  constexpr double kMargin = 1.06;
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
