#include <imgui.h>

#include <array>

#include "isobrick/viewer/render/scene_renderer.h"
#include "isobrick/viewer/window/panel_controls.h"
#include "isobrick/viewer/window/panel_tools.h"

namespace isobrick {
namespace {

// The colours of values, from the first to the last.
void valueBar(ColorMap map, float scale) {
  const ImVec2 at = ImGui::GetCursorScreenPos();
  const ImVec2 size{ImGui::GetContentRegionAvail().x, 10.0f * scale};
  ImGui::Dummy(size);
  // ImGui mixes sRGB values, the surfaces light: parts so small that it makes no difference.
  constexpr int kParts = 64;
  const auto colorAt = [map](int part) {
    const glm::vec3 c = valueColor(map, static_cast<double>(part) / kParts);
    return ImGui::ColorConvertFloat4ToU32({c.r, c.g, c.b, 1.0f});
  };
  const float step = size.x / kParts;
  for (int i = 0; i < kParts; ++i) {
    const ImU32 low = colorAt(i), high = colorAt(i + 1);
    const float x = at.x + step * static_cast<float>(i);
    ImGui::GetWindowDrawList()->AddRectFilledMultiColor({x, at.y}, {x + step, at.y + size.y}, low,
                                                        high, high, low);
  }
}

// Which plane distances are measured from. It stays where it is until another one is chosen.
void planeOfValues(ViewSession& session) {
  ViewState& state = session.state();
  const auto choose = [&](const glm::dvec3& normal, double offset) {
    state.values.plane = {normal, offset};
    state.values.plane_window.reset();
  };
  ImGui::AlignTextToFramePadding();
  ImGui::TextDisabled("plane");
  constexpr std::array<const char*, 3> kNames{"x##plane", "y##plane", "z##plane"};
  for (glm::length_t axis = 0; axis < 3; ++axis) {
    ImGui::SameLine();
    glm::dvec3 normal(0.0);
    normal[axis] = 1.0;
    if (ImGui::Button(kNames[static_cast<std::size_t>(axis)]))
      choose(normal, session.volume().geometry.indexToWorld(state.focus.center)[axis]);
    explain("The plane through the focus across this axis of the world.");
  }
  for (std::size_t i = 0; i < state.clip_planes.size(); ++i) {
    ImGui::SameLine();
    if (ImGui::Button(text("cut %d##plane", static_cast<int>(i) + 1).c_str()))
      choose(state.clip_planes[i].normal, state.clip_planes[i].offset);
    explain("The place of this clip plane.");
  }
}

void legendOfPieces(const ViewSession& session) {
  if (session.waitsForPieces()) return ImGui::TextDisabled("finding the pieces");
  const PictureLegend legend = session.notes().meaning;
  for (const PictureLegend::Patch& patch : legend.patches) {
    patchOf(patch.color);
    ImGui::TextUnformatted(patch.text.c_str());
  }
  if (!legend.rest.empty()) ImGui::TextDisabled("%s", legend.rest.c_str());
}

void coloring(ViewSession& session, float scale) {
  ViewState& state = session.state();
  int chosen = static_cast<int>(state.coloring);
  if (ImGui::Combo("colour by", &chosen,
                   "surface\0level\0gradient\0another pyramid\0distance to a plane\0piece\0"))
    state.coloring = static_cast<ViewColoring>(chosen);
  explain(
      "What the colours mean: that of the surface's line; the level of the pyramid, red the "
      "finest; "
      "how steep the volume is there; the values of another pyramid at the same place; how far "
      "away a plane is; the connected piece, by its area.");
  const bool by_other = state.coloring == ViewColoring::kOther;
  if (by_other) {
    std::array<char, 1024> path{};
    state.values.other.copy(path.data(), path.size() - 1);
    // Opened when it is typed, not at each letter.
    if (ImGui::InputText("pyramid", path.data(), path.size(), ImGuiInputTextFlags_EnterReturnsTrue))
      state.values.other = path.data();
  }
  if (state.coloring == ViewColoring::kPlaneDistance) planeOfValues(session);
  if (state.coloring == ViewColoring::kComponent) legendOfPieces(session);
  const auto window = session.valueWindow();
  if (!window) return;
  valueBar(state.values.map, scale);
  int map = static_cast<int>(state.values.map);
  if (ImGui::Combo("colours", &map, "viridis\0cividis\0inferno\0cool to warm\0grey\0"))
    state.values.map = static_cast<ColorMap>(map);
  explain(
      "All but one get lighter evenly, to colour-blind eyes too. Cool to warm has a light middle, "
      "for values on both sides of one.");
  const auto [least, greatest] = session.valueRange();
  std::array<double, 2> wanted = *window;
  const bool by_gradient = state.coloring == ViewColoring::kGradient;
  const ImGuiSliderFlags flags = by_gradient ? ImGuiSliderFlags_Logarithmic : 0;
  const bool first = sliderOf("first", wanted[0], least, greatest, "%.4g", flags);
  explain("The value of the colour on the left.");
  const bool last = sliderOf("last", wanted[1], least, greatest, "%.4g", flags);
  explain("The value of the colour on the right.");
  sliderOf("first opacity", state.values.opacity[0], 0.0, 1.0, "%.2f");
  explain("Of the colour on the left; those between follow. Below 1 you see through.");
  sliderOf("last opacity", state.values.opacity[1], 0.0, 1.0, "%.2f");
  explain("Of the colour on the right.");
  if (!first && !last) return;
  (by_gradient ? state.values.gradient_window
   : by_other  ? state.values.other_window
               : state.values.plane_window) = wanted;
}

}  // namespace

void appearanceControls(ViewSession& session, float scale) {
  if (!ImGui::CollapsingHeader("appearance", ImGuiTreeNodeFlags_DefaultOpen)) return;
  ViewState& state = session.state();
  coloring(session, scale);
  ImGui::Checkbox("transitions", &state.show_transitions);
  explain("The cells that join two levels, in a colour of their own.");
  bool headlight = state.lighting == ViewLighting::kHeadlight;
  if (ImGui::Checkbox("headlight", &headlight))
    state.lighting = headlight ? ViewLighting::kHeadlight : ViewLighting::kThreeLights;
  explain("One light at the eye, or three that stay with the camera (L).");
  ImGui::SameLine();
  ImGui::Checkbox("ambient occlusion", &state.ambient_occlusion);
  explain(
      "Darkens the surface in hollows, by the picture's depths. Takes time without a graphics "
      "card.");
  ImGui::Checkbox("shadow", &state.shadow);
  explain("Surfaces that nothing is seen through keep the light from what is behind them.");
  ImGui::Checkbox("box", &state.show_box);
  explain("The edges of the volume (B).");
  ImGui::SameLine();
  ImGui::Checkbox("handles", &state.show_handles);
  explain("Arrows at the focus and squares at clip planes, to drag (T).");
  ImGui::SameLine();
  ImGui::Checkbox("orthographic", &state.camera.orthographic);
  explain("Without perspective (O).");
  sliderOf("field of view", state.camera.vertical_fov, 10.0, 90.0, "%.0f degrees");
  ImGui::AlignTextToFramePadding();
  ImGui::TextDisabled("background");
  for (const Background& background : kBackgrounds) {
    ImGui::SameLine();
    if (ImGui::Button(background.name)) {
      state.background_top = background.top;
      state.background_bottom = background.bottom;
    }
    explain("For screens: dark. For slides: light. For print: white.");
  }
  ImGui::ColorEdit3("top", &state.background_top.r, ImGuiColorEditFlags_NoInputs);
  ImGui::SameLine();
  ImGui::ColorEdit3("bottom", &state.background_bottom.r, ImGuiColorEditFlags_NoInputs);
}

}  // namespace isobrick
