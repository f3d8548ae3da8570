#include <imgui.h>

#include <array>

#include "isobrick/viewer/window/panel_controls.h"
#include "isobrick/viewer/window/panel_tools.h"
#include "isobrick/viewer/window/view_panel.h"

namespace isobrick {
namespace {

void surfaces(ViewSession& session, float scale) {
  if (!ImGui::CollapsingHeader("surfaces", ImGuiTreeNodeFlags_DefaultOpen)) return;
  ViewState& state = session.state();
  std::optional<std::size_t> removed;
  for (std::size_t i = 0; i < state.surfaces.size(); ++i) {
    ViewSurface& surface = state.surfaces[i];
    ImGui::PushID(static_cast<int>(i));
    if (ImGui::RadioButton("##active", state.active_surface == static_cast<int>(i)))
      state.active_surface = static_cast<int>(i);
    explain("The active surface, which the isovalue above, the arrow keys and mesh files are of.");
    ImGui::SameLine();
    ImGui::Checkbox("##visible", &surface.visible);
    explain("Shown, or not.");
    ImGui::SameLine();
    ImGui::ColorEdit3("##color", &surface.color.r, ImGuiColorEditFlags_NoInputs);
    explain("Its colour.");
    ImGui::SameLine();
    ImGui::SetNextItemWidth(110.0f * scale);
    sliderOf("##opacity", surface.opacity, 0.0, 1.0, "opacity %.2f");
    explain("Below 1 you see through it.");
    ImGui::SameLine();
    ImGui::Text("%.6g", surface.isovalue);
    if (state.surfaces.size() > 1) {
      ImGui::SameLine();
      if (ImGui::Button("x")) removed = i;
      explain("Removes this surface.");
    }
    ImGui::PopID();
  }
  constexpr std::size_t kMostSurfaces = 8;
  if (state.surfaces.size() < kMostSurfaces && ImGui::Button("add surface")) {
    ViewSurface surface = activeSurface(state);
    surface.color = {0.85f, 0.45f, 0.35f};
    state.surfaces.push_back(surface);
    state.active_surface = static_cast<int>(state.surfaces.size()) - 1;
  }
  if (removed) removeSurface(*removed, state);
}

void slices(ViewSession& session) {
  if (!ImGui::CollapsingHeader("slices")) return;
  ViewState& state = session.state();
  ImGui::Checkbox("three views", &state.slice_views.shown);
  explain(
      "The slices flat beside the scene (U), with the surfaces' contours. Drag: the place where "
      "they cross; right drag: black and white; wheel: the next slice; Ctrl+wheel: nearer; "
      "Shift+drag: move; double click: focus there.");
  const std::array<const char*, 3> names{"across x", "across y", "across z"};
  for (int axis = 0; axis < 3; ++axis) {
    ViewSlice& slice = state.slices[static_cast<std::size_t>(axis)];
    ImGui::PushID(axis);
    ImGui::Checkbox("##shown", &slice.shown);
    explain("A slice through the volume.");
    ImGui::SameLine();
    sliderOf(names[static_cast<std::size_t>(axis)], slice.position, 0.0,
             static_cast<double>(session.volume().voxels[axis] - 1), "%.0f");
    ImGui::PopID();
  }
  const ValueHistogram& range = session.histogram();
  sliderOf("opacity", state.slice_opacity, 0.0, 1.0, "%.2f");
  explain("Below 1 you see through slices.");
  bool has_threshold = state.slice_threshold.has_value();
  if (ImGui::Checkbox("leave out values below", &has_threshold)) {
    state.slice_threshold.reset();
    if (has_threshold) state.slice_threshold = activeSurface(state).isovalue;
  }
  explain("So that air does not hide the surface.");
  if (state.slice_threshold)
    sliderOf("threshold", *state.slice_threshold, range.least, range.greatest, "%.5g");
  sliderOf("black", state.value_window[0], range.least, range.greatest, "%.5g");
  explain("The value that slices and caps show black.");
  sliderOf("white", state.value_window[1], range.least, range.greatest, "%.5g");
  explain("The value that slices and caps show white.");
}

void meshDistance(std::optional<double>& distance, float scale) {
  constexpr double kFirst = 0.5;  // voxels
  bool simplified = distance.has_value();
  if (ImGui::Checkbox("simplify meshes", &simplified))
    distance = simplified ? std::optional(kFirst) : std::nullopt;
  explain("Mesh files get fewer triangles, within this distance of the surface.");
  if (!distance) return;
  ImGui::SameLine();
  ImGui::SetNextItemWidth(110.0f * scale);
  sliderOf("##within", *distance, 0.05, 10.0, "within %.2f voxels", ImGuiSliderFlags_Logarithmic);
}

Wishes files(ViewState& state, float scale) {
  Wishes wishes;
  if (!ImGui::CollapsingHeader("files")) return wishes;
  const auto button = [](const char* label, const char* what, bool goes_on = true) {
    const bool pressed = ImGui::Button(label);
    explain(what);
    if (goes_on) ImGui::SameLine();
    return pressed;
  };
  wishes.browse = button("open", "Another volume (N), or drop one on the window.");
  wishes.screenshot = button("picture", "The scene without panels, as PNG (P).");
  wishes.screenshot_exr = button("EXR", "The scene with depth and normals (Shift+P).");
  wishes.export_mesh = button("mesh", "The active surface, as fine as it is wanted (M).", false);
  wishes.save_state = button("save view", "All of these settings, as JSON (Ctrl+S).");
  wishes.load_state = button("load view", "The saved view again (Ctrl+O).", false);
  ImGui::Checkbox("transparent", &state.pictures.transparent);
  explain("Pictures without a background.");
  ImGui::SameLine();
  ImGui::SetNextItemWidth(80.0f * scale);
  ImGui::SliderInt("x window", &state.pictures.times, 1, kMostPictureTimes);
  explain("Pixels of pictures along each side, in windows.");
  ImGui::Checkbox("scale bar", &state.pictures.scale_bar);
  explain("In pictures, at the point that the camera turns about.");
  ImGui::SameLine();
  ImGui::Checkbox("axes", &state.pictures.axes);
  explain("The directions of x, y and z, in pictures.");
  ImGui::SameLine();
  ImGui::Checkbox("legend", &state.pictures.legend);
  explain("What the colours mean, in pictures.");
  meshDistance(state.mesh_distance, scale);
  return wishes;
}

}  // namespace

Wishes buildControls(ViewSession& session, float scale) {
  // Controls of two sections may have the same label, and are not the same control.
  const auto section = [](const char* id, const auto& controls) {
    ImGui::PushID(id);
    controls();
    ImGui::PopID();
  };
  Wishes wishes;
  section("isovalue", [&] { isovalueControls(session, scale); });
  section("detail", [&] { detailControls(session); });
  section("surfaces", [&] { surfaces(session, scale); });
  section("cut", [&] { cutControls(session, scale); });
  section("appearance", [&] { appearanceControls(session, scale); });
  section("slices", [&] { slices(session); });
  section("pieces", [&] { pieceControls(session, scale); });
  section("measure", [&] { addWishes(measureControls(session), wishes); });
  section("files", [&] { addWishes(files(session.state(), scale), wishes); });
  return wishes;
}

}  // namespace isobrick
