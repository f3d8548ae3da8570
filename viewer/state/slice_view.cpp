#include "isobrick/viewer/state/slice_view.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>

namespace isobrick {
namespace {

// For each axis of the world the axis of the voxels that lies nearest to it.
std::array<int, 3> nearestAxes(const GridGeometry& geometry) {
  std::array<int, 3> best{0, 1, 2};
  double most = -1.0;
  std::array<int, 3> order{0, 1, 2};
  do {
    double sum = 0.0;
    for (int world = 0; world < 3; ++world)
      sum += std::abs(geometry.direction[order[static_cast<std::size_t>(world)]][world]);
    if (sum <= most + 1e-9) continue;
    most = sum;
    best = order;
  } while (std::next_permutation(order.begin(), order.end()));
  return best;
}

}  // namespace

glm::dvec2 SliceFrame::pixelOf(const glm::dvec3& index) const {
  const glm::dvec3 from = index - corner;
  return {glm::dot(from, right) / glm::dot(right, right),
          glm::dot(from, down) / glm::dot(down, down)};
}

SliceFrame sliceFrame(const ViewState& state, const ViewVolume& volume, int view,
                      const glm::dvec2& size) {
  // Along x you see y to the right, along y and z x; along z you see y downwards, else z upwards.
  const int world_right = view == 0 ? 1 : 0;
  const int world_down = view == 2 ? 1 : 2;
  const bool is_down = view == 2;
  const GridGeometry& geometry = volume.geometry;
  const std::array<int, 3> axes = nearestAxes(geometry);
  SliceFrame frame;
  frame.axis = axes[static_cast<std::size_t>(view)];
  const int across = axes[static_cast<std::size_t>(world_right)];
  const int along = axes[static_cast<std::size_t>(world_down)];
  const auto sign = [&](int axis, int world) {
    return geometry.direction[axis][world] < 0.0 ? -1.0 : 1.0;
  };
  constexpr double kMargin = 1.04;  // around the volume
  const auto length = [&](int axis) {
    return static_cast<double>(volume.voxels[axis] - 1) * geometry.spacing[axis];
  };
  const glm::dvec2 shown = glm::max(size, glm::dvec2(1.0));
  const double per_pixel = kMargin * std::max(length(across) / shown.x, length(along) / shown.y) /
                           state.slice_views.zoom;  // world units
  frame.right[across] = sign(across, world_right) * per_pixel / geometry.spacing[across];
  frame.down[along] =
      (is_down ? 1.0 : -1.0) * sign(along, world_down) * per_pixel / geometry.spacing[along];
  frame.center = state.slice_views.center.value_or(0.5 * glm::dvec3(volume.voxels - Index3(1)));
  frame.corner = frame.center;
  frame.corner[frame.axis] = state.slices[static_cast<std::size_t>(frame.axis)].position;
  frame.corner -= 0.5 * (frame.right * shown.x + frame.down * shown.y);
  constexpr std::array<std::array<const char*, 2>, 3> kNames{
      {{"-x", "+x"}, {"-y", "+y"}, {"-z", "+z"}}};
  const auto& across_names = kNames[static_cast<std::size_t>(world_right)];
  const auto& along_names = kNames[static_cast<std::size_t>(world_down)];
  frame.sides = {across_names[0], across_names[1], along_names[is_down ? 0 : 1],
                 along_names[is_down ? 1 : 0]};
  return frame;
}

void crossAt(const SliceFrame& frame, const glm::dvec3& index, ViewState& state) {
  for (int axis = 0; axis < 3; ++axis)
    if (axis != frame.axis)
      state.slices[static_cast<std::size_t>(axis)].position = std::round(index[axis]);
}

void stepSlice(const SliceFrame& frame, double steps, ViewState& state) {
  double& position = state.slices[static_cast<std::size_t>(frame.axis)].position;
  position = std::round(position + steps);
}

void zoomSlices(const SliceFrame& frame, const glm::dvec2& pixel, double factor, ViewState& state) {
  const double before = state.slice_views.zoom;
  state.slice_views.zoom = std::clamp(before * factor, kLeastSliceZoom, kMostSliceZoom);
  const double grown = state.slice_views.zoom / before;
  // The middle of the picture moves towards what is under the cursor.
  const glm::dvec3 under = frame.indexAt(pixel);
  glm::dvec3 center = under + (frame.center - under) / grown;
  center[frame.axis] = frame.center[frame.axis];
  state.slice_views.center = center;
}

void moveSlices(const SliceFrame& frame, const glm::dvec2& from, const glm::dvec2& to,
                ViewState& state) {
  state.slice_views.center =
      frame.center - frame.right * (to.x - from.x) - frame.down * (to.y - from.y);
}

void dragWindow(const glm::dvec2& pixels, const ViewVolume& volume, ViewState& state) {
  constexpr double kPixels = 400.0;
  const double range = volume.greatest_value - volume.least_value;
  if (!(range > 0.0)) return;
  const auto [black, white] = state.value_window;
  const double least = 1e-4 * range;
  const double width = std::max(least, white - black + range * pixels.x / kPixels);
  const double level = 0.5 * (black + white) + range * pixels.y / kPixels;
  state.value_window = {level - 0.5 * width, level + 0.5 * width};
}

}  // namespace isobrick
