#include "isobrick/viewer/state/view_state.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/trigonometric.hpp>
#include <limits>

namespace isobrick {

WorldBox ViewVolume::box() const {
  return boxAround(glm::dvec3(0.0), glm::dvec3(voxels - Index3(1)));
}

WorldBox ViewVolume::boxAround(const glm::dvec3& lower, const glm::dvec3& upper) const {
  WorldBox box = emptyWorldBox();
  for (const glm::dvec3& corner : cornersOf({lower, upper}))
    box.include(geometry.indexToWorld(corner));
  return box;
}

double ViewVolume::diagonal() const { return glm::length(glm::dvec3(voxels - Index3(1))); }

void removeSurface(std::size_t surface, ViewState& state) {
  state.surfaces.erase(state.surfaces.begin() + static_cast<std::ptrdiff_t>(surface));
  const int last = static_cast<int>(state.surfaces.size()) - 1;
  if (static_cast<int>(surface) < state.active_surface || state.active_surface > last)
    --state.active_surface;
}

ViewState firstView(const ViewVolume& volume, double aspect) {
  ViewState state;
  const double span = volume.greatest_value - volume.least_value;
  state.surfaces[0].isovalue = volume.least_value + 0.5 * span;
  state.focus.center = 0.5 * glm::dvec3(volume.voxels - Index3(1));
  state.focus.everywhere = true;
  // If that becomes a region of interest, half of the volume is in it.
  state.focus.radius = std::max(
      8.0,
      0.25 * static_cast<double>(std::max({volume.voxels.x, volume.voxels.y, volume.voxels.z})));
  for (int axis = 0; axis < 3; ++axis)
    state.slices[static_cast<std::size_t>(axis)].position = std::floor(state.focus.center[axis]);
  state.value_window = {volume.least_value, volume.greatest_value};
  state.show_box = false;  // the surface is framed
  state.camera = framed(state.camera, volume.box(), aspect);
  return state;
}

std::string missingMask(const ViewRegion& region, const OpenMasks& open) {
  for (const ViewMask& mask : region.masks)
    if (!open.contains(mask.path)) return mask.path;
  return {};
}

SurfaceRegion surfaceRegionOf(const ViewRegion& region, const OpenMasks& open, double step) {
  SurfaceRegion result;
  result.half_spaces = region.half_spaces;
  for (HalfSpace& half_space : result.half_spaces) half_space.offset /= step;
  for (const ViewBall& ball : region.balls)
    result.balls.push_back({ball.center / step, ball.radius / step});
  for (const ViewMask& mask : region.masks)
    if (const auto found = open.find(mask.path); found != open.end())
      result.masks.push_back({found->second, mask.value});
  return result;
}

namespace {

// A unit vector keeps its bits: divided once more it would be another one, and its cut made anew
// with every frame.
glm::dvec3 unitNormal(glm::dvec3 normal) {
  constexpr double kRounding = 8.0 * std::numeric_limits<double>::epsilon();
  if (std::abs(glm::length(normal) - 1.0) <= kRounding) return normal;
  const double most = std::max({std::abs(normal.x), std::abs(normal.y), std::abs(normal.z)});
  if (!(most > 0.0)) return {1.0, 0.0, 0.0};
  normal /= most;  // its squares stay finite and above 0
  return normal / glm::length(normal);
}

}  // namespace

ViewState bounded(const ViewState& state, const ViewVolume& volume) {
  ViewState result = state;
  const glm::dvec3 last(volume.voxels - Index3(1));
  if (result.surfaces.empty()) result.surfaces.emplace_back();
  result.step = std::max(0, result.step);
  result.active_surface =
      std::clamp(result.active_surface, 0, static_cast<int>(result.surfaces.size()) - 1);
  for (ViewSurface& surface : result.surfaces) {
    if (volume.has_all_values && surface.volume == 0)
      surface.isovalue = std::clamp(surface.isovalue, volume.least_value, volume.greatest_value);
    surface.opacity = std::clamp(surface.opacity, 0.0, 1.0);
    surface.pieces = bounded(surface.pieces);
  }
  if (result.focus.follow_view)
    result.focus.center = volume.geometry.worldToIndex(result.camera.pivot);
  result.focus.center = glm::clamp(result.focus.center, glm::dvec3(0.0), last);
  result.focus.radius = std::clamp(result.focus.radius, 1.0, volume.diagonal());
  result.pictures.times = std::clamp(result.pictures.times, 1, kMostPictureTimes);
  if (result.mesh_distance) result.mesh_distance = std::clamp(*result.mesh_distance, 0.01, 1000.0);
  if (result.view_pixels) result.view_pixels = std::clamp(*result.view_pixels, 0.1, 1000.0);
  if (result.clip_planes.size() > kMostClipPlanes) result.clip_planes.resize(kMostClipPlanes);
  for (ViewClipPlane& plane : result.clip_planes) plane.normal = unitNormal(plane.normal);
  result.values.plane.normal = unitNormal(result.values.plane.normal);
  for (double& opacity : result.values.opacity) opacity = std::clamp(opacity, 0.0, 1.0);
  result.slice_opacity = std::clamp(result.slice_opacity, 0.0, 1.0);
  for (int axis = 0; axis < 3; ++axis) {
    double& position = result.slices[static_cast<std::size_t>(axis)].position;
    position = std::clamp(position, 0.0, last[axis]);
  }
  ViewSliceViews& views = result.slice_views;
  views.zoom = std::clamp(views.zoom, kLeastSliceZoom, kMostSliceZoom);
  if (views.center) views.center = glm::clamp(*views.center, glm::dvec3(0.0), last);
  if (result.measurements.size() > kMostMeasurements) result.measurements.resize(kMostMeasurements);
  if (result.piece_measures.size() > kMostPieceMeasures)
    result.piece_measures.resize(kMostPieceMeasures);
  const double size = glm::length(volume.box().upper - volume.box().lower);
  result.camera.distance = std::clamp(result.camera.distance, 1e-5 * size, 100.0 * size);
  result.camera.vertical_fov = std::clamp(result.camera.vertical_fov, 1.0, 150.0);
  result.camera.elevation = std::clamp(result.camera.elevation, -90.0, 90.0);
  return result;
}

double wantedRadius(const ViewState& state, const ViewVolume& volume) {
  return state.focus.everywhere ? volume.diagonal()
                                : std::min(state.focus.radius, volume.diagonal());
}

SurfaceWish SurfaceWish::withoutLists() const {
  SurfaceWish result = *this;
  for (Surface& surface : result.surfaces) surface.listed.reset();
  return result;
}

SurfaceWish wishOf(const ViewState& state, const ViewVolume& volume, double height) {
  SurfaceWish wish;
  for (const ViewSurface& surface : state.surfaces)
    wish.surfaces.push_back(
        {surface.isovalue, surface.pieces, surface.visible, nullptr, surface.inside});
  wish.radius = wantedRadius(state, volume);
  wish.detail.focus = state.focus.center;
  wish.detail.curvature_tolerance = state.curvature_tolerance;
  wish.detail.capped = state.capped;
  wish.detail.region = state.region;
  if (state.coloring == ViewColoring::kGradient || state.coloring == ViewColoring::kOther)
    wish.detail.values = state.coloring;
  if (state.coloring == ViewColoring::kOther) wish.detail.other = state.values.other;
  if (state.view_pixels) {
    const PlacedCamera camera = placeCamera(state.camera, 1.0);
    ViewPoint& view = wish.detail.view.emplace();
    view.eye = camera.eye;
    view.pixels = *state.view_pixels;
    const double pixels = std::max(height, 1.0);
    view.pixels_per_radian = pixels / glm::radians(state.camera.vertical_fov);
    if (camera.orthographic) view.pixels_per_unit = pixels / (2.0 * camera.half_height);
  }
  return wish;
}

Query queryOf(const SurfaceWish& wish, const ViewVolume& volume, std::size_t surface,
              double radius) {
  Query query;
  query.isovalue = wish.surfaces[surface].isovalue;
  query.inside = wish.surfaces[surface].inside;
  query.curvature_tolerance = wish.detail.curvature_tolerance;
  query.cap = wish.detail.capped;
  query.view = wish.detail.view;
  if (radius < volume.diagonal()) query.focus = FocusSphere{wish.detail.focus, radius};
  return query;
}

}  // namespace isobrick
