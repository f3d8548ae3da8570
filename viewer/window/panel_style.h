// The font and the colours of the panels.
#pragma once

#include <imgui.h>

#include <array>

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

}  // namespace isobrick
