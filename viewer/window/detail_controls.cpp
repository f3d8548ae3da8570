#include <imgui.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "isobrick/viewer/window/panel_controls.h"
#include "isobrick/viewer/window/panel_tools.h"

namespace isobrick {
namespace {

// A box that says whether there is a value, and a slider that makes one.
bool optionalSlider(const char* label, std::optional<double>& value, double first, double least,
                    double most, const char* format) {
  bool on = value.has_value();
  ImGui::PushID(label);
  if (ImGui::Checkbox("##on", &on)) value = on ? std::optional(first) : std::nullopt;
  ImGui::PopID();
  ImGui::SameLine();
  ImGui::SetNextItemWidth(ImGui::CalcItemWidth() - ImGui::GetFrameHeight() -
                          ImGui::GetStyle().ItemSpacing.x);
  double shown = value.value_or(first);
  const bool moved = sliderOf(label, shown, least, most, format, ImGuiSliderFlags_Logarithmic);
  if (moved) value = shown;
  return moved;
}

void focusControls(const ViewVolume& volume, ViewFocus& focus) {
  ImGui::Checkbox("finest everywhere", &focus.everywhere);
  explain(
      "All of the surface at full resolution, or only what lies within a sphere around the focus, "
      "coarser with distance.");
  ImGui::SameLine();
  ImGui::BeginDisabled(focus.everywhere);
  ImGui::Checkbox("sphere", &focus.show_sphere);
  ImGui::EndDisabled();
  explain("Draws the sphere (S). In the scene, its arrows move it and the square makes it larger.");
  if (sliderOf("radius", focus.radius, 4.0, volume.diagonal(), "%.0f voxels",
               ImGuiSliderFlags_Logarithmic))
    focus.everywhere = false;
  explain("Of interest: full resolution within so many voxels of the focus.");
  constexpr std::array<const char*, 3> kNames{"##x", "##y", "##z"};
  const float gap = ImGui::GetStyle().ItemInnerSpacing.x;
  const float width = (ImGui::CalcItemWidth() - 2.0f * gap) / 3.0f;
  ImGui::BeginDisabled(focus.follow_view);
  for (int axis = 0; axis < 3; ++axis) {
    ImGui::SetNextItemWidth(width);
    if (sliderOf(kNames[static_cast<std::size_t>(axis)], focus.center[axis], 0.0,
                 static_cast<double>(volume.voxels[axis] - 1), "%.0f"))
      focus.everywhere = false;
    ImGui::SameLine(0.0f, gap);
  }
  ImGui::EndDisabled();
  ImGui::TextUnformatted("focus");
  explain("Its x, y and z, in voxels. A double click on the surface puts it there.");
}

}  // namespace

void detailControls(ViewSession& session) {
  ViewState& state = session.state();
  focusControls(session.volume(), state.focus);
  // A view may ask for it where there is none, and has to be able to stop.
  if (session.pyramid().spec().has_curvature || state.curvature_tolerance) {
    // As a radius: flatter than a sphere of so many voxels.
    const auto inverse = [](double value) { return std::sqrt(0.5 / std::max(value, 1e-12)); };
    std::optional<double> radius;
    if (state.curvature_tolerance) radius = inverse(*state.curvature_tolerance);
    const bool moved = optionalSlider("flatter than", radius, 10.0, 1.0, 400.0, "%.1f voxels");
    explain("Level 1 where the surface is flatter than a sphere of this radius.");
    if (moved || radius.has_value() != state.curvature_tolerance.has_value())
      state.curvature_tolerance = radius ? std::optional(0.5 / (*radius * *radius)) : std::nullopt;
  }
  optionalSlider("cells under", state.view_pixels, 2.0, 0.5, 50.0, "%.1f pixels");
  explain("Coarser where cells are that small in the picture.");
  ImGui::Checkbox("wireframe", &state.wireframe);
  explain("The edges of the triangles (W).");
  ImGui::SameLine();
  bool by_level = state.coloring == ViewColoring::kLevel;
  if (ImGui::Checkbox("levels", &by_level))
    state.coloring = by_level ? ViewColoring::kLevel : ViewColoring::kPlain;
  explain("Colours the triangles by their level, red the finest (C).");
  ImGui::SameLine();
  ImGui::Checkbox("follow the view", &state.focus.follow_view);
  explain("The focus is the point that the camera turns about (V).");
}

}  // namespace isobrick
