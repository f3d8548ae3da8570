#include "isobrick/viewer/window/panel_tools.h"

#include <array>
#include <cmath>
#include <utility>

#include "isobrick/viewer/notes/draw_notes.h"

namespace isobrick {
namespace {

constexpr double kFontPixels = 16.0;  // of an ordinary screen

void setFont(double scale) {
  ImGuiIO& io = ImGui::GetIO();
  io.Fonts->Clear();
  if (kInterfaceFontBytes == 0) {
    io.FontGlobalScale = static_cast<float>(scale);
    return;
  }
  // Latin, Greek and Cyrillic letters, for names of files, and signs of units.
  static constexpr std::array<ImWchar, 7> kLetters{0x0020, 0x052f, 0x1e00, 0x22ff, 0, 0, 0};
  ImFontConfig config;
  config.FontDataOwnedByAtlas = false;
  config.OversampleH = config.OversampleV = 1;  // the atlas of a large scale would get too large
  config.PixelSnapH = false;
  io.Fonts->AddFontFromMemoryTTF(const_cast<unsigned char*>(kInterfaceFont), kInterfaceFontBytes,
                                 static_cast<float>(std::round(kFontPixels * scale)), &config,
                                 kLetters.data());
}

void setColors() {
  ImGui::StyleColorsDark();
  ImVec4* const colors = ImGui::GetStyle().Colors;
  const ImVec4 accent{0.42f, 0.66f, 0.93f, 1.0f};
  colors[ImGuiCol_Text] = {0.94f, 0.95f, 0.96f, 1.0f};
  colors[ImGuiCol_TextDisabled] = {0.72f, 0.74f, 0.77f, 1.0f};
  colors[ImGuiCol_WindowBg] = {0.105f, 0.115f, 0.13f, 1.0f};
  colors[ImGuiCol_PopupBg] = {0.08f, 0.09f, 0.10f, 1.0f};
  colors[ImGuiCol_Border] = {0.27f, 0.29f, 0.32f, 1.0f};
  colors[ImGuiCol_FrameBg] = {0.18f, 0.195f, 0.22f, 1.0f};
  colors[ImGuiCol_FrameBgHovered] = {0.22f, 0.25f, 0.29f, 1.0f};
  colors[ImGuiCol_FrameBgActive] = {0.24f, 0.29f, 0.35f, 1.0f};
  colors[ImGuiCol_TitleBg] = {0.08f, 0.09f, 0.10f, 1.0f};
  colors[ImGuiCol_TitleBgActive] = {0.14f, 0.19f, 0.25f, 1.0f};
  colors[ImGuiCol_Button] = {0.20f, 0.25f, 0.31f, 1.0f};
  colors[ImGuiCol_ButtonHovered] = {0.24f, 0.33f, 0.43f, 1.0f};
  colors[ImGuiCol_ButtonActive] = {0.22f, 0.39f, 0.55f, 1.0f};
  colors[ImGuiCol_Header] = {0.15f, 0.17f, 0.195f, 1.0f};
  colors[ImGuiCol_HeaderHovered] = {0.21f, 0.25f, 0.30f, 1.0f};
  colors[ImGuiCol_HeaderActive] = {0.24f, 0.31f, 0.39f, 1.0f};
  // Under the text of a slider, so no lighter than text allows.
  colors[ImGuiCol_SliderGrab] = {0.22f, 0.40f, 0.58f, 1.0f};
  colors[ImGuiCol_SliderGrabActive] = {0.24f, 0.43f, 0.62f, 1.0f};
  colors[ImGuiCol_CheckMark] = accent;
  colors[ImGuiCol_PlotLines] = accent;
}

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

void setPanelStyle(double scale) {
  setFont(scale);
  ImGuiStyle& style = ImGui::GetStyle();
  style = ImGuiStyle();  // that of another scale may have been there
  setColors();
  style.WindowRounding = 0.0f;
  style.FrameRounding = style.GrabRounding = 3.0f;
  style.PopupRounding = 4.0f;
  style.WindowPadding = {10.0f, 8.0f};
  style.FramePadding = {7.0f, 3.0f};
  style.ItemSpacing = {7.0f, 6.0f};
  style.ItemInnerSpacing = {6.0f, 4.0f};
  style.ScrollbarSize = 12.0f;
  style.WindowBorderSize = 0.0f;
  style.ScaleAllSizes(static_cast<float>(scale));
}

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
