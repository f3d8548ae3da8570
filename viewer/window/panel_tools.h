// The common part of the panels that are drawn with Dear ImGui.
#pragma once

#include <imgui.h>

#include <array>
#include <cstdio>
#include <glm/vec3.hpp>
#include <string>

#include "isobrick/viewer/window/window_layout.h"

namespace isobrick {

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
