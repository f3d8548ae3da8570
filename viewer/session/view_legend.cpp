#include "isobrick/viewer/session/view_legend.h"

#include <algorithm>
#include <cstdio>
#include <filesystem>

#include "isobrick/viewer/color_map.h"
#include "isobrick/viewer/session/folder_listing.h"
#include "isobrick/viewer/state/short_number.h"

namespace isobrick {
namespace {

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

PictureNotes notesOf(const ViewState& state, const std::vector<LevelCounts>& levels,
                     const std::optional<std::array<double, 2>>& window, LengthUnit unit,
                     const std::vector<ColoredPieces>& pieces) {
  PictureNotes notes;
  notes.scale_bar = state.pictures.scale_bar;
  notes.axes = state.pictures.axes;
  notes.legend = state.pictures.legend;
  notes.unit = unit;
  for (const ViewMeasurement& measurement : state.measurements)
    notes.marks.push_back({measurement.points, measurementText(measurement, unit)});
  for (const ViewPieceMeasure& piece : state.piece_measures)
    notes.marks.push_back({{piece.point}, pieceText(piece, unit)});
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
