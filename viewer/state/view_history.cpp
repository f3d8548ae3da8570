#include "isobrick/viewer/state/view_history.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>

namespace isobrick {

void ViewHistory::note(const ViewState& view, bool is_held, double seconds) {
  if (views_.empty()) return remember(view);
  if (view == views_[at_]) {
    changing_.reset();
    return;
  }
  if (is_held || !changing_ || view != *changing_) {
    changing_ = view;
    changed_ = seconds;
  } else if (seconds - changed_ >= kRestSeconds) {
    remember(view);
  }
}

std::optional<ViewState> ViewHistory::undo(const ViewState& now) {
  if (views_.empty()) return std::nullopt;
  if (now != views_[at_]) remember(now);
  if (at_ == 0) return std::nullopt;
  return views_[--at_];
}

std::optional<ViewState> ViewHistory::redo(const ViewState& now) {
  // After another change there is nothing to come back to.
  if (views_.empty() || now != views_[at_] || at_ + 1 == views_.size()) return std::nullopt;
  return views_[++at_];
}

void ViewHistory::remember(const ViewState& view) {
  changing_.reset();
  if (!views_.empty()) views_.resize(at_ + 1);
  views_.push_back(view);
  if (views_.size() > kMostViews) views_.pop_front();
  at_ = views_.size() - 1;
}

namespace {

// -180 .. 180.
double turnOf(double degrees) { return std::remainder(degrees, 360.0); }

ViewCamera cameraBetween(const ViewCamera& a, const ViewCamera& b, double share) {
  ViewCamera camera = a;
  camera.pivot = glm::mix(a.pivot, b.pivot, share);
  camera.distance =
      isPlaced(a) && isPlaced(b) ? a.distance * std::pow(b.distance / a.distance, share) : 0.0;
  camera.azimuth = turnOf(a.azimuth + share * turnOf(b.azimuth - a.azimuth));
  camera.elevation = std::lerp(a.elevation, b.elevation, share);
  camera.vertical_fov = std::lerp(a.vertical_fov, b.vertical_fov, share);
  return camera;
}

void moveSurface(ViewSurface& surface, const ViewSurface& to, double share) {
  surface.isovalue = std::lerp(surface.isovalue, to.isovalue, share);
  surface.color = glm::mix(surface.color, to.color, static_cast<float>(share));
  // A surface comes and goes by its opacity.
  const double from = surface.visible ? surface.opacity : 0.0, end = to.visible ? to.opacity : 0.0;
  surface.visible = surface.visible || to.visible;
  surface.opacity = std::lerp(from, end, share);
}

void moveClipPlane(ViewClipPlane& plane, const ViewClipPlane& to, double share) {
  const glm::dvec3 normal = glm::mix(plane.normal, to.normal, share);
  const double length = glm::length(normal);
  if (length > 1e-6) plane.normal = normal / length;  // opposite ones have no way between them
  plane.offset = std::lerp(plane.offset, to.offset, share);
}

}  // namespace

std::vector<ViewState> turntable(const ViewState& view, int count) {
  std::vector<ViewState> views(static_cast<std::size_t>(count), view);
  for (int i = 0; i < count; ++i)
    views[static_cast<std::size_t>(i)].camera.azimuth =
        turnOf(view.camera.azimuth + 360.0 * i / count);
  return views;
}

ViewState viewBetween(const ViewState& a, const ViewState& b, double share) {
  if (share <= 0.0) return a;
  if (share >= 1.0) return b;
  ViewState view = a;
  view.camera = cameraBetween(a.camera, b.camera, share);
  view.focus.center = glm::mix(a.focus.center, b.focus.center, share);
  view.focus.radius = std::lerp(a.focus.radius, b.focus.radius, share);
  if (a.surfaces.size() == b.surfaces.size())
    for (std::size_t i = 0; i < b.surfaces.size(); ++i)
      moveSurface(view.surfaces[i], b.surfaces[i], share);
  if (a.clip_planes.size() == b.clip_planes.size())
    for (std::size_t i = 0; i < b.clip_planes.size(); ++i)
      moveClipPlane(view.clip_planes[i], b.clip_planes[i], share);
  for (std::size_t i = 0; i < b.slices.size(); ++i)
    view.slices[i].position = std::lerp(a.slices[i].position, b.slices[i].position, share);
  view.slice_opacity = std::lerp(a.slice_opacity, b.slice_opacity, share);
  const auto part = static_cast<float>(share);
  view.background_top = glm::mix(a.background_top, b.background_top, part);
  view.background_bottom = glm::mix(a.background_bottom, b.background_bottom, part);
  return view;
}

std::vector<ViewState> viewsAlong(const std::vector<ViewState>& stops, int count) {
  assert(stops.size() >= 2 && count >= 2);
  const std::size_t ways = stops.size() - 1;
  std::vector<ViewState> views;
  for (int i = 0; i < count; ++i) {
    const double place = static_cast<double>(ways) * i / (count - 1);
    const std::size_t way = std::min(static_cast<std::size_t>(place), ways - 1);
    views.push_back(viewBetween(stops[way], stops[way + 1], place - static_cast<double>(way)));
  }
  return views;
}

}  // namespace isobrick
