#include "isobrick/viewer/window/panel_keys.h"

#include <array>
#include <utility>

namespace isobrick {
namespace {

constexpr std::array kPanelKeys{
    std::pair{Key::kTab, ImGuiKey_Tab},
    std::pair{Key::kLeft, ImGuiKey_LeftArrow},
    std::pair{Key::kRight, ImGuiKey_RightArrow},
    std::pair{Key::kUp, ImGuiKey_UpArrow},
    std::pair{Key::kDown, ImGuiKey_DownArrow},
    std::pair{Key::kHome, ImGuiKey_Home},
    std::pair{Key::kEnd, ImGuiKey_End},
    std::pair{Key::kDelete, ImGuiKey_Delete},
    std::pair{Key::kBackspace, ImGuiKey_Backspace},
    std::pair{Key::kEnter, ImGuiKey_Enter},
    std::pair{Key::kEscape, ImGuiKey_Escape},
    std::pair{Key::kA, ImGuiKey_A},
    std::pair{Key::kC, ImGuiKey_C},
    std::pair{Key::kV, ImGuiKey_V},
    std::pair{Key::kX, ImGuiKey_X},
    std::pair{Key::kY, ImGuiKey_Y},
    std::pair{Key::kZ, ImGuiKey_Z},
};

}  // namespace

#if IMGUI_VERSION_NUM >= 18900

void setUpPanelKeys() {
  // InputRouter gives a frame what it can take; ImGui would spread that over frames once more.
  ImGui::GetIO().ConfigInputTrickleEventQueue = false;
}

void setPanelKey(Key key, bool is_down) {
  for (const auto& [ours, theirs] : kPanelKeys)
    if (ours == key) ImGui::GetIO().AddKeyEvent(theirs, is_down);
}

void setPanelModifiers(bool shift, bool control) {
  ImGui::GetIO().AddKeyEvent(ImGuiMod_Shift, shift);
  ImGui::GetIO().AddKeyEvent(ImGuiMod_Ctrl, control);
}

bool isPanelKeyPressed(ImGuiKey key) { return ImGui::IsKeyPressed(key, false); }

#else

void setUpPanelKeys() {
  for (const auto& [ours, theirs] : kPanelKeys)
    ImGui::GetIO().KeyMap[theirs] = static_cast<int>(ours);
}

void setPanelKey(Key key, bool is_down) {
  ImGui::GetIO().KeysDown[static_cast<int>(key)] = is_down;
}

void setPanelModifiers(bool shift, bool control) {
  ImGui::GetIO().KeyShift = shift;
  ImGui::GetIO().KeyCtrl = control;
}

bool isPanelKeyPressed(ImGuiKey key) { return ImGui::IsKeyPressed(ImGui::GetKeyIndex(key), false); }

#endif

}  // namespace isobrick
