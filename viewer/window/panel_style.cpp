#include "isobrick/viewer/window/panel_style.h"

#include <cmath>

#include "isobrick/viewer/notes/interface_font.h"

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

}  // namespace isobrick
