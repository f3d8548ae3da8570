#include "isobrick/viewer/session/scene_of_view.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <filesystem>
#include <glm/geometric.hpp>
#include <limits>

#include "isobrick/extract/color_map.h"
#include "isobrick/viewer/session/folder_listing.h"
#include "isobrick/viewer/state/measurement.h"

namespace isobrick {
namespace {

constexpr glm::vec3 kTransitionColor{0.93f, 0.22f, 0.62f};

std::string isovalueText(double isovalue) {
  std::array<char, 48> text{};
  std::snprintf(text.data(), text.size(), "isovalue %.6g", isovalue);
  return text.data();
}

std::string valuesText(const ViewState& state, LengthUnit unit) {
  const bool is_known = unit == LengthUnit::kMillimetre;
  if (state.coloring == ViewColoring::kGradient)
    return is_known ? "gradient per mm" : "gradient per unit of length";
  if (state.coloring == ViewColoring::kPlaneDistance)
    return is_known ? "distance to plane, mm" : "distance to plane";
  return shownName(std::filesystem::path(state.values.other).stem().string());
}

}  // namespace

std::vector<WantedPlane> planesOf(const ViewState& state, const ViewVolume& volume, double height) {
  constexpr double kLeastValues = 512.0;
  const PlacedCamera camera = placeCamera(state.camera, 1.0);
  const double seen =
      2.0 * camera.half_height * (camera.orthographic ? 1.0 : state.camera.distance);
  const glm::dmat3 to_world = volume.geometry.indexToWorldMatrix();
  // Twice the pixels at the pivot: parts of the plane are nearer, and a level has half of the next.
  const auto mostValues = [&](const IndexPlane& plane) {
    const double side =
        std::max(glm::length(to_world * plane.across), glm::length(to_world * plane.along));
    const double values = 2.0 * side / seen * height;
    return static_cast<int>(std::clamp(values, kLeastValues, double{kMostPlaneValues}));
  };
  std::vector<WantedPlane> planes;
  for (int axis = 0; axis < 3; ++axis) {
    const ViewSlice& slice = state.slices[static_cast<std::size_t>(axis)];
    if (!slice.shown || !(state.slice_opacity > 0.0)) continue;
    const IndexPlane plane = slicePlane(volume.voxels, axis, slice.position);
    planes.push_back({plane, -1, axis, mostValues(plane)});
  }
  int number = 0, slot = 2;
  for (const ViewClipPlane& clip : state.clip_planes) {
    ++slot;
    if (!clip.enabled) continue;
    const auto plane = capPlane(volume.voxels, volume.geometry, clip.normal, clip.offset);
    if (clip.cap && plane) planes.push_back({*plane, number, slot, mostValues(*plane)});
    ++number;
  }
  return planes;
}

SceneFrame sceneOf(const ViewState& state, const ViewVolume& volume, int width, int height) {
  SceneFrame frame;
  frame.width = width;
  frame.height = height;
  frame.camera = placeCamera(state.camera, static_cast<double>(width) / height);
  frame.bounds = volume.box();
  frame.lattice = {volume.geometry.indexToWorldMatrix(), volume.geometry.origin};
  frame.surfaces.clear();
  for (const ViewSurface& surface : state.surfaces) {
    // The surface of a greater value lies within that of a smaller one.
    frame.surfaces.push_back({surface.color, surface.visible ? surface.opacity : 0.0});
  }
  frame.color_by_level = state.coloring == ViewColoring::kLevel;
  frame.color_map = state.values.map;
  frame.wireframe = state.wireframe;
  if (state.show_transitions) frame.transition_color = kTransitionColor;
  frame.headlight = state.lighting == ViewLighting::kHeadlight;
  frame.ambient_occlusion = state.ambient_occlusion;
  frame.shadow = state.shadow;
  frame.value_opacity = state.values.opacity;
  for (const ViewClipPlane& plane : state.clip_planes)
    if (plane.enabled) frame.clip_planes.push_back({plane.normal, plane.offset});
  if (state.show_box) {
    const std::array<glm::dvec3, 8> corners = worldCorners(volume.geometry, volume.voxels);
    for (unsigned i = 0; i < 8; ++i)
      for (const unsigned axis : {1u, 2u, 4u})
        if ((i & axis) == 0) frame.segments.push_back({corners[i], corners[i | axis]});
  }
  if (state.focus.show_sphere && !state.focus.everywhere) {
    const double radius = state.focus.radius * volume.geometry.leastSpacing();
    const glm::dvec3 center = volume.geometry.indexToWorld(state.focus.center);
    frame.sphere = SphereOutline{center, radius};
    frame.fill_sphere = true;
    frame.bounds.include(center - radius);
    frame.bounds.include(center + radius);
  }
  frame.background_top = state.background_top;
  frame.background_bottom = state.background_bottom;
  return frame;
}

std::array<double, 2> valueRangeOf(const ViewState& state, const ViewVolume& volume,
                                   const std::array<double, 2>& of_vertices) {
  if (state.coloring != ViewColoring::kPlaneDistance) return of_vertices;
  std::array<double, 2> range{std::numeric_limits<double>::infinity(),
                              -std::numeric_limits<double>::infinity()};
  for (const glm::dvec3& corner : cornersOf(volume.box())) {
    const double away = glm::dot(state.values.plane.normal, corner) - state.values.plane.offset;
    range = {std::min(range[0], away), std::max(range[1], away)};
  }
  return range;
}

std::optional<std::array<double, 2>> valueWindowOf(const ViewState& state,
                                                   const std::array<double, 2>& range) {
  const double span = range[1] - range[0];
  if (!(span > 0.0)) return std::nullopt;
  const ViewValues& values = state.values;
  switch (state.coloring) {
    case ViewColoring::kGradient:
      return values.gradient_window.value_or(std::array{range[0], range[0] + 0.25 * span});
    case ViewColoring::kOther:
      return values.other_window.value_or(range);
    case ViewColoring::kPlaneDistance:
      return values.plane_window.value_or(range);
    case ViewColoring::kPlain:
    case ViewColoring::kLevel:
    case ViewColoring::kComponent:
      break;
  }
  return std::nullopt;
}

SceneSlice sliceOf(const WantedPlane& wanted, SliceId image, const ViewState& state,
                   const ViewVolume& volume) {
  const glm::dmat3 matrix = volume.geometry.indexToWorldMatrix();
  SceneSlice slice;
  slice.image = image;
  slice.corner = volume.geometry.indexToWorld(wanted.plane.corner);
  slice.across = matrix * wanted.plane.across;
  slice.along = matrix * wanted.plane.along;
  slice.cap_of = wanted.cap_of;
  slice.black = volume.stored_values.stored(state.value_window[0]);
  slice.white = volume.stored_values.stored(state.value_window[1]);
  if (state.slice_threshold)
    slice.least_value = volume.stored_values.stored(*state.slice_threshold);
  slice.opacity = state.slice_opacity;
  if (wanted.cap_of >= 0) {
    slice.opacity = 1.0;
    slice.least_value.reset();
    for (const ViewSurface& surface : state.surfaces) {
      if (!surface.visible || surface.volume != 0) continue;
      const double value = volume.stored_values.stored(surface.isovalue);
      if (surface.inside == InsideOf::kBelow)
        slice.below_value = std::max(value, slice.below_value.value_or(value));
      else
        slice.least_value = std::min(value, slice.least_value.value_or(value));
    }
    if (!slice.least_value && !slice.below_value)
      slice.least_value = std::numeric_limits<double>::infinity();
  }
  return slice;
}

void addPieces(const std::vector<ColoredPieces>& surfaces, LengthUnit unit, PictureLegend& legend) {
  const std::size_t most = std::max<std::size_t>(1, kComponentColorCount / surfaces.size());
  std::size_t more = 0;
  for (const ColoredPieces& surface : surfaces) {
    const std::size_t lines = std::min(most, surface.largest.size());
    more += surface.count - lines;
    for (std::size_t i = 0; i < lines; ++i) {
      const auto& [number, area] = surface.largest[i];
      std::string text = surfaces.size() > 1 ? isovalueText(surface.isovalue) + ", " : "";
      text += "piece " + std::to_string(number) + ": area " + shortNumber(area);
      if (unit == LengthUnit::kMillimetre) text += " mm\u00b2";
      legend.patches.push_back({componentColor(number), text});
    }
  }
  if (more > 0) legend.rest = "and " + std::to_string(more) + " smaller, in the same colours";
}

std::vector<PictureMark> marksOf(const ViewState& state, LengthUnit unit) {
  std::vector<PictureMark> marks;
  for (const ViewMeasurement& measurement : state.measurements)
    marks.push_back({measurement.points, measurementText(measurement, unit)});
  for (const ViewPieceMeasure& piece : state.piece_measures)
    marks.push_back({{piece.point}, pieceText(piece, unit)});
  return marks;
}

PictureNotes notesOf(const ViewState& state, const std::vector<LevelCounts>& levels,
                     const std::optional<std::array<double, 2>>& window, LengthUnit unit,
                     const std::vector<ColoredPieces>& pieces) {
  PictureNotes notes;
  notes.scale_bar = state.pictures.scale_bar;
  notes.axes = state.pictures.axes;
  notes.legend = state.pictures.legend;
  notes.unit = unit;
  notes.marks = marksOf(state, unit);
  if (state.coloring == ViewColoring::kLevel) {
    for (const LevelCounts& level : levels)
      notes.meaning.patches.push_back(
          {levelColor(level.level), "level " + std::to_string(level.level)});
    return notes;
  }
  if (!pieces.empty()) {
    addPieces(pieces, unit, notes.meaning);
    return notes;
  }
  if (window) {
    notes.meaning.ramp = window;
    notes.meaning.ramp_colors = state.values.map;
    notes.meaning.ramp_title = valuesText(state, unit);
    return notes;
  }
  for (const ViewSurface& surface : state.surfaces)
    if (surface.visible && surface.opacity > 0.0)
      notes.meaning.patches.push_back({surface.color, isovalueText(surface.isovalue)});
  return notes;
}

}  // namespace isobrick
