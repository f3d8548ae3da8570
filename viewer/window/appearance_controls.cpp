#include <imgui.h>

#include <array>

#include "isobrick/viewer/window/panel_controls.h"
#include "isobrick/viewer/window/panel_tools.h"

namespace isobrick {
namespace {

// The colours of values, from the darkest to the lightest.
void valueBar(float scale) {
  const ImVec2 at = ImGui::GetCursorScreenPos();
  const ImVec2 size{ImGui::GetContentRegionAvail().x, 10.0f * scale};
  ImGui::Dummy(size);
  // ImGui mixes sRGB values, the surfaces light: parts so small that it makes no difference.
  constexpr int kParts = 64;
  const auto colorAt = [](int part) {
    const glm::vec3 c = valueColor(static_cast<double>(part) / kParts);
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

// The meaning of the surfaces' colours.
void coloring(ViewSession& session, float scale) {
  ViewState& state = session.state();
  int chosen = static_cast<int>(state.coloring);
  if (ImGui::Combo("colour by", &chosen, "surface\0level\0gradient\0another pyramid\0"))
    state.coloring = static_cast<ViewColoring>(chosen);
  explain(
      "What the colours mean: that of the surface's line; the level of the pyramid, red the "
      "finest; "
      "how steep the volume is there; the values of another pyramid at the same place.");
  const bool by_other = state.coloring == ViewColoring::kOther;
  if (by_other) {
    std::array<char, 1024> path{};
    state.values.other.copy(path.data(), path.size() - 1);
    // Opened when it is typed, not at each letter.
    if (ImGui::InputText("pyramid", path.data(), path.size(), ImGuiInputTextFlags_EnterReturnsTrue))
      state.values.other = path.data();
  }
  const auto window = session.valueWindow();
  if (!window) return;
  valueBar(scale);
  const auto [least, greatest] = session.valueRange();
  std::array<double, 2> wanted = *window;
  const ImGuiSliderFlags flags = by_other ? 0 : ImGuiSliderFlags_Logarithmic;
  const bool dark = sliderOf("darkest", wanted[0], least, greatest, "%.4g", flags);
  const bool light = sliderOf("lightest", wanted[1], least, greatest, "%.4g", flags);
  if (dark || light) (by_other ? state.values.other_window : state.values.gradient_window) = wanted;
}

}  // namespace

void appearanceControls(ViewSession& session, float scale) {
  if (!ImGui::CollapsingHeader("appearance", ImGuiTreeNodeFlags_DefaultOpen)) return;
  ViewState& state = session.state();
  coloring(session, scale);
  ImGui::Checkbox("wireframe", &state.wireframe);
  explain("The edges of the triangles (W).");
  ImGui::SameLine();
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
  ImGui::SameLine();
  ImGui::ColorEdit3("top", &state.background_top.r, ImGuiColorEditFlags_NoInputs);
  ImGui::SameLine();
  ImGui::ColorEdit3("bottom", &state.background_bottom.r, ImGuiColorEditFlags_NoInputs);
}

}  // namespace isobrick
