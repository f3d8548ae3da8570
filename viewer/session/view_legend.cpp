#include "isobrick/viewer/session/view_legend.h"

#include <cstdio>
#include <filesystem>

#include "isobrick/viewer/offscreen_renderer.h"
#include "isobrick/viewer/session/folder_listing.h"

namespace isobrick {
namespace {

std::string isovalueText(double isovalue) {
  std::array<char, 48> text{};
  std::snprintf(text.data(), text.size(), "isovalue %.6g", isovalue);
  return text.data();
}

}  // namespace

PictureNotes notesOf(const ViewState& state, const std::vector<LevelCounts>& levels,
                     const std::optional<std::array<double, 2>>& window, LengthUnit unit) {
  PictureNotes notes;
  notes.scale_bar = state.pictures.scale_bar;
  notes.axes = state.pictures.axes;
  notes.legend = state.pictures.legend;
  notes.unit = unit;
  for (const ViewMeasurement& measurement : state.measurements)
    notes.marks.push_back({measurement.points, measurementText(measurement, unit)});
  if (state.coloring == ViewColoring::kLevel) {
    for (const LevelCounts& level : levels)
      notes.meaning.patches.push_back(
          {levelColor(level.level), "level " + std::to_string(level.level)});
    return notes;
  }
  if (window) {
    const bool is_gradient = state.coloring == ViewColoring::kGradient;
    const std::string per = unit == LengthUnit::kMillimetre ? "mm" : "unit of length";
    notes.meaning.ramp = window;
    notes.meaning.ramp_title =
        is_gradient ? "gradient per " + per
                    : shownName(std::filesystem::path(state.values.other).stem().string());
    return notes;
  }
  for (const ViewSurface& surface : state.surfaces)
    if (surface.visible && surface.opacity > 0.0)
      notes.meaning.patches.push_back({surface.color, isovalueText(surface.isovalue)});
  return notes;
}

}  // namespace isobrick
