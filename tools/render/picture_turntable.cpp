#include "tools/render/picture_turntable.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/trigonometric.hpp>

#include "isobrick/viewer/state/view_camera.h"

namespace isobrick {
namespace {

template <typename F>
void forEachVertex(const PictureSurface& surface, F&& f) {
  for (const SurfaceChunk& chunk : surface.chunks)
    for (const SurfaceVertex& vertex : chunk.vertices)
      f(surface.lattice.toWorld(chunk.origin + glm::dvec3(vertex.position)));
}

// In front, with a sphere around the middle of the surface just in the picture.
ViewCamera cameraAround(const RenderOptions& options, const PictureSurface& surface) {
  constexpr double kMargin = 1.06;
  WorldBox box = emptyWorldBox();
  forEachVertex(surface, [&](const glm::dvec3& point) { box.include(point); });
  ViewCamera camera;
  if (box.empty()) return camera;
  camera.pivot = box.center();
  double radius = 0.0;
  forEachVertex(surface, [&](const glm::dvec3& point) {
    radius = std::max(radius, glm::distance(point, camera.pivot));
  });
  const double half_height = std::tan(0.5 * glm::radians(options.vertical_fov));
  const double half_width = half_height * options.width / options.height;
  const double sine = std::sin(std::atan(std::min(half_height, half_width)));
  if (radius > 0.0) camera.distance = kMargin * radius / sine;
  return camera;
}

}  // namespace

std::vector<RenderOptions> turntable(const RenderOptions& options, const PictureSurface& surface,
                                     int count) {
  ViewCamera camera = cameraAround(options, surface);
  camera.elevation = std::clamp(options.orbit.elevation, -90.0, 90.0);
  std::vector<RenderOptions> all;
  for (int i = 0; i < count; ++i) {
    camera.azimuth = options.orbit.azimuth + 360.0 * i / count;
    const PlacedCamera placed = placeCamera(camera, 1.0);
    all.push_back(options);
    all.back().look_at = LookAtCamera{placed.eye, camera.pivot, placed.up};
  }
  return all;
}

}  // namespace isobrick
