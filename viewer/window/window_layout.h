// Which part of the window shows what.
#pragma once

#include <algorithm>

namespace isobrick {

// In pixels of an ordinary screen.
inline constexpr double kPanelWidth = 330.0;
inline constexpr double kStatusHeight = 28.0;  // of the line at the foot

// The scene, in pixels of the window from its left and its lower edge.
struct SceneArea {
  int left = 0, bottom = 0, width = 0, height = 0;
};

// The panel's width, pixels; in a small window half is left for the scene.
inline double panelWidth(double window_width, double scale) {
  return std::max(1.0, std::min(scale * kPanelWidth, 0.5 * window_width));
}

// Beside the panel, if that is shown, and over the line at the foot. Empty if the window is.
inline SceneArea sceneArea(int window_width, int window_height, double scale, bool with_panel) {
  SceneArea area;
  area.left = with_panel ? static_cast<int>(panelWidth(window_width, scale)) : 0;
  area.bottom = std::min(static_cast<int>(scale * kStatusHeight), window_height / 2);
  area.width = std::max(0, window_width - area.left);
  area.height = std::max(0, window_height - area.bottom);
  return area;
}

}  // namespace isobrick
