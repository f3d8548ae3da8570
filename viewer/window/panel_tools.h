// The common part of the panels that are drawn with Dear ImGui: font and colours, keys, and small
// controls.
#pragma once

#include <imgui.h>

#include <array>
#include <cstdio>
#include <glm/vec3.hpp>
#include <string>

#include "isobrick/viewer/state/input_event.h"
#include "isobrick/viewer/window/view_panel.h"

namespace isobrick {

inline const ImVec4 kWarningText{1.0f, 0.85f, 0.5f, 1.0f};
inline const ImVec4 kErrorText{1.0f, 0.6f, 0.5f, 1.0f};

// For the current context of Dear ImGui, between two frames. `scale`: pixels of this screen that
// are one of an ordinary one. All text has a contrast of at least 4.5 : 1 (WCAG 2.2, 1.4.3) to the
// colours of kTextGrounds.
void setPanelStyle(double scale);

// Of the colour of a level, in the bar that says how many triangles it has.
inline constexpr float kLevelBarShade = 0.45f;

// The colours that text stands on.
inline constexpr std::array kTextGrounds{
    ImGuiCol_WindowBg,      ImGuiCol_PopupBg,      ImGuiCol_FrameBg,       ImGuiCol_FrameBgHovered,
    ImGuiCol_FrameBgActive, ImGuiCol_TitleBg,      ImGuiCol_TitleBgActive, ImGuiCol_Button,
    ImGuiCol_ButtonHovered, ImGuiCol_ButtonActive, ImGuiCol_Header,        ImGuiCol_HeaderHovered,
    ImGuiCol_HeaderActive};

// Of the current context, once, before its first frame.
void setUpPanelKeys();

// The next frame sees it. Keys that no panel knows are left out.
void setPanelKey(Key key, bool is_down);
void setPanelModifiers(bool shift, bool control);

// In this frame, not by repetition.
bool isPanelKeyPressed(ImGuiKey key);

inline float statusHeight(float scale) { return static_cast<float>(kStatusHeight) * scale; }

// As printf has it, cut after 255 characters.
template <typename... Arguments>
std::string text(const char* format, Arguments... arguments) {
  std::array<char, 256> buffer{};
  std::snprintf(buffer.data(), buffer.size(), format, arguments...);
  return buffer.data();
}

// What the control before does, beside it when the mouse rests there.
inline void explain(const char* text) {
  constexpr double kRestSeconds = 0.3;
  const double still = *static_cast<const double*>(ImGui::GetIO().UserData);
  if (still < kRestSeconds || !ImGui::IsItemHovered(ImGuiHoveredFlags_AllowWhenDisabled)) return;
  ImGui::BeginTooltip();
  ImGui::PushTextWrapPos(20.0f * ImGui::GetFontSize());
  ImGui::TextUnformatted(text);
  ImGui::PopTextWrapPos();
  ImGui::EndTooltip();
}

// A patch of a colour, sRGB, before the text that says what it means.
inline void patchOf(const glm::vec3& color) {
  const float side = ImGui::GetTextLineHeight();
  const ImVec2 at = ImGui::GetCursorScreenPos();
  ImGui::GetWindowDrawList()->AddRectFilled(
      at, {at.x + side, at.y + side},
      ImGui::ColorConvertFloat4ToU32({color.r, color.g, color.b, 1.0f}));
  ImGui::Dummy({side, side});
  ImGui::SameLine();
}

inline bool sliderOf(const char* label, double& value, double least, double greatest,
                     const char* format, ImGuiSliderFlags flags = 0) {
  return ImGui::SliderScalar(label, ImGuiDataType_Double, &value, &least, &greatest, format, flags);
}

}  // namespace isobrick
