// The panels' colours can be read, and their font has what units and names are written with.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "isobrick/extract/color_map.h"
#include "isobrick/viewer/window/panel_tools.h"

namespace isobrick {
namespace {

// WCAG 2.2: relative luminance, and the contrast of two colours.
double luminance(const ImVec4& color) {
  const auto linear = [](float channel) {
    const double c = static_cast<double>(channel);
    return c <= 0.04045 ? c / 12.92 : std::pow((c + 0.055) / 1.055, 2.4);
  };
  return 0.2126 * linear(color.x) + 0.7152 * linear(color.y) + 0.0722 * linear(color.z);
}

double contrast(const ImVec4& a, const ImVec4& b) {
  const auto [dark, light] = std::minmax({luminance(a), luminance(b)});
  return (light + 0.05) / (dark + 0.05);
}

class PanelStyleTest : public ::testing::TestWithParam<double> {
 protected:
  PanelStyleTest() {
    ImGui::CreateContext();
    setPanelStyle(GetParam());
  }
  ~PanelStyleTest() override { ImGui::DestroyContext(); }
};

TEST_P(PanelStyleTest, TextCanBeReadOnAllThatItStandsOn) {
  const ImVec4* const colors = ImGui::GetStyle().Colors;
  for (const ImGuiCol ground : kTextGrounds) {
    EXPECT_GE(contrast(colors[ImGuiCol_Text], colors[ground]), 4.5)
        << ImGui::GetStyleColorName(ground);
    EXPECT_EQ(colors[ground].w, 1.0f) << ImGui::GetStyleColorName(ground);
  }
  // The grab of a slider is under its text.
  for (const ImGuiCol grab : {ImGuiCol_SliderGrab, ImGuiCol_SliderGrabActive})
    EXPECT_GE(contrast(colors[ImGuiCol_Text], colors[grab]), 4.5);
  for (const ImVec4& text : {kWarningText, kErrorText, colors[ImGuiCol_TextDisabled]})
    EXPECT_GE(contrast(text, colors[ImGuiCol_WindowBg]), 4.5);
  for (int level = 0; level < 8; ++level) {
    const glm::vec3 bar = kLevelBarShade * levelColor(level);
    EXPECT_GE(contrast(colors[ImGuiCol_Text], {bar.r, bar.g, bar.b, 1.0f}), 4.5) << level;
  }
  // What is ticked is seen (1.4.11).
  EXPECT_GE(contrast(colors[ImGuiCol_CheckMark], colors[ImGuiCol_FrameBg]), 3.0);
}

TEST_P(PanelStyleTest, TheFontHasLettersOfUnitsAndNames) {
  unsigned char* pixels = nullptr;
  int width = 0, height = 0;
  ImGui::GetIO().Fonts->GetTexDataAsAlpha8(&pixels, &width, &height);
  EXPECT_LE(width, 4096);
  EXPECT_LE(height, 4096);
  const ImFont& font = *ImGui::GetIO().Fonts->Fonts[0];
  for (const ImWchar letter : std::u16string(u"\u00b5\u00b2\u00b0\u00e9\u00df\u03b1\u0416\u2026"))
    EXPECT_NE(font.FindGlyphNoFallback(letter), nullptr) << std::hex << letter;
  EXPECT_NEAR(font.FontSize, 16.0 * GetParam(), 0.51);
}

INSTANTIATE_TEST_SUITE_P(Scales, PanelStyleTest, ::testing::Values(1.0, 1.25, 2.0, 2.5));

}  // namespace
}  // namespace isobrick
