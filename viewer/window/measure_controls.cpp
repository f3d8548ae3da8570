#include <imgui.h>

#include <optional>

#include "isobrick/viewer/window/panel_controls.h"
#include "isobrick/viewer/window/panel_tools.h"

namespace isobrick {

Wishes measureControls(ViewSession& session) {
  Wishes wishes;
  if (!ImGui::CollapsingHeader("measure")) return wishes;
  Interaction& interaction = session.interaction();
  ViewState& state = session.state();
  const auto toolButton = [&](const char* label, Interaction::Tool tool, const char* what) {
    bool on = interaction.tool == tool;
    if (ImGui::Checkbox(label, &on)) chooseTool(on ? tool : Interaction::Tool::kNone, interaction);
    explain(what);
  };
  toolButton(
      "distance", Interaction::Tool::kDistance,
      "Click two points of the surface (D). Esc ends it, Backspace takes the last one back.");
  ImGui::SameLine();
  toolButton("angle", Interaction::Tool::kAngle,
             "Click three points of the surface; the angle is at the second (A).");
  toolButton("distance over the surface", Interaction::Tool::kSurfaceDistance,
             "Click two points of the active surface: the length of the shortest way over it "
             "(Shift+D).");
  if (session.paths().busy()) {
    ImGui::SameLine();
    ImGui::ProgressBar(session.paths().progress());
  }
  const LengthUnit unit = session.pyramid().spec().geometry.unit;
  const PathOf path_of = session.paths().asked();
  std::optional<std::size_t> removed;
  for (std::size_t i = 0; i < state.measurements.size(); ++i) {
    ImGui::PushID(static_cast<int>(i));
    if (ImGui::Button("x")) removed = i;
    explain("Removes this measurement.");
    ImGui::SameLine();
    ImGui::AlignTextToFramePadding();
    ImGui::Text("%zu   %s", i + 1, measurementText(state.measurements[i], unit, path_of).c_str());
    ImGui::PopID();
  }
  if (removed)
    state.measurements.erase(state.measurements.begin() + static_cast<std::ptrdiff_t>(*removed));
  std::optional<std::size_t> removed_piece;
  for (std::size_t i = 0; i < state.piece_measures.size(); ++i) {
    ImGui::PushID(static_cast<int>(state.measurements.size() + i));
    if (ImGui::Button("x")) removed_piece = i;
    explain("Removes this measurement.");
    ImGui::SameLine();
    ImGui::AlignTextToFramePadding();
    ImGui::Text("%zu   %s", state.measurements.size() + i + 1,
                pieceText(state.piece_measures[i], unit).c_str());
    ImGui::PopID();
  }
  if (removed_piece)
    state.piece_measures.erase(state.piece_measures.begin() +
                               static_cast<std::ptrdiff_t>(*removed_piece));
  if (!state.measurements.empty() || !state.piece_measures.empty()) {
    wishes.export_measurements = ImGui::Button("write CSV");
    explain("All of them as a table, with the points in world units.");
  }
  return wishes;
}

}  // namespace isobrick
