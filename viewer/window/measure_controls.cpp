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
  const LengthUnit unit = session.pyramid().spec().geometry.unit;
  // They count on from one list to the next.
  auto rows = [number = 0](auto& list, const auto& textOf) mutable {
    std::optional<std::size_t> removed;
    for (std::size_t i = 0; i < list.size(); ++i) {
      ImGui::PushID(number++);
      if (ImGui::Button("x")) removed = i;
      explain("Removes this measurement.");
      ImGui::SameLine();
      ImGui::AlignTextToFramePadding();
      ImGui::Text("%d   %s", number, textOf(list[i]).c_str());
      ImGui::PopID();
    }
    if (removed) list.erase(list.begin() + static_cast<std::ptrdiff_t>(*removed));
  };
  rows(state.measurements, [&](const ViewMeasurement& of) { return measurementText(of, unit); });
  rows(state.piece_measures, [&](const ViewPieceMeasure& of) { return pieceText(of, unit); });
  if (!state.measurements.empty() || !state.piece_measures.empty()) {
    wishes.export_measurements = ImGui::Button("write CSV");
    explain("All of them as a table, with the points in world units.");
  }
  return wishes;
}

}  // namespace isobrick
