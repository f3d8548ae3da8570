#include "isobrick/viewer/window/panel_controls.h"

#include <imgui.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <glm/geometric.hpp>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/viewer/window/panel_tools.h"
#include "isobrick/viewer/window/view_panel.h"

namespace isobrick {

void cutControls(ViewSession& session, float scale) {
  if (!ImGui::CollapsingHeader("clip planes", ImGuiTreeNodeFlags_DefaultOpen)) return;
  ViewState& state = session.state();
  const WorldBox box = session.volume().box();
  std::optional<std::size_t> removed;
  for (std::size_t i = 0; i < state.clip_planes.size(); ++i) {
    ViewClipPlane& plane = state.clip_planes[i];
    ImGui::PushID(static_cast<int>(i));
    double least = 1e300, most = -1e300;
    for (const glm::dvec3& corner : cornersOf(box)) {
      least = std::min(least, glm::dot(corner, plane.normal));
      most = std::max(most, glm::dot(corner, plane.normal));
    }
    ImGui::Checkbox("##enabled", &plane.enabled);
    explain("Cuts, or not.");
    ImGui::SameLine();
    ImGui::SetNextItemWidth(80.0f * scale);
    sliderOf("##offset", plane.offset, least, most, "%.1f");
    explain("Its place along its normal, in world units. In the scene, drag the square.");
    ImGui::SameLine();
    ImGui::Checkbox("cap", &plane.cap);
    explain("Shows the volume's values on the cut, inside the surface.");
    ImGui::SameLine();
    if (ImGui::Button("flip")) {
      plane.normal = -plane.normal;
      plane.offset = -plane.offset;
    }
    explain("Keeps the other side. I flips the last plane.");
    ImGui::SameLine();
    if (ImGui::Button("x")) removed = i;
    explain("Removes this plane.");
    ImGui::SetNextItemWidth(200.0f * scale);
    std::array<float, 3> normal{static_cast<float>(plane.normal.x),
                                static_cast<float>(plane.normal.y),
                                static_cast<float>(plane.normal.z)};
    if (ImGui::DragFloat3("normal", normal.data(), 0.01f, -1.0f, 1.0f, "%.2f")) {
      const glm::dvec3 wanted(normal[0], normal[1], normal[2]);
      if (glm::length(wanted) > 1e-3) plane.normal = glm::normalize(wanted);
    }
    explain("The direction of what stays, in the world's axes.");
    ImGui::PopID();
  }
  if (removed)
    state.clip_planes.erase(state.clip_planes.begin() + static_cast<std::ptrdiff_t>(*removed));
  if (state.clip_planes.size() == kMostClipPlanes) return;
  ImGui::AlignTextToFramePadding();
  ImGui::TextDisabled("add a plane across");
  for (const char* axis : {"x", "y", "z"}) {
    ImGui::SameLine();
    const bool is_wanted = ImGui::Button(axis);
    explain("Through the focus. The keys X, Y and Z turn it on and off.");
    if (is_wanted) return addClipPlane(*axis - 'x', session.volume(), state);
  }
}

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

void surfaces(ViewSession& session, float scale) {
  if (!ImGui::CollapsingHeader("surfaces", ImGuiTreeNodeFlags_DefaultOpen)) return;
  ViewState& state = session.state();
  const std::vector<std::string>& sources = session.besideSources();
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
    if (const int beside = surface.volume - 1; beside >= 0 && beside < std::ssize(sources)) {
      ImGui::SameLine();
      const std::filesystem::path source = sources[static_cast<std::size_t>(beside)];
      ImGui::TextDisabled("%s", shownName(source.stem().string()).c_str());
    }
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

void timeControls(ViewSession& session, int steps) {
  if (steps == 0) return;
  ImGui::SliderInt("step", &session.state().step, 0, steps - 1);
  explain("Of time: which FILE is shown. The up and down arrows go from one to the next.");
  ImGui::SameLine();
  ImGui::Checkbox("play", &session.interaction().playing);
  explain("One after the other, and again; each is made while the one before is shown (J).");
}

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
