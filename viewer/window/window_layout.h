// Which part of the window shows what.
#pragma once

#include <algorithm>
#include <array>

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

// The scene and, if they are shown, the flat views of the slices along x, y and z of the world.
struct WindowAreas {
  SceneArea scene;
  std::array<SceneArea, 3> slices = {};
};

// Beside the panel, if that is shown, and over the line at the foot; with slices the scene is the
// upper right quarter, axial, coronal and sagittal slices (across z, y and x) are at the upper
// left, the lower left and the lower right. Areas are empty if the window is.
inline WindowAreas windowAreas(int window_width, int window_height, double scale, bool with_panel,
                               bool with_slices) {
  WindowAreas areas;
  SceneArea& all = areas.scene;
  all.left = with_panel ? static_cast<int>(panelWidth(window_width, scale)) : 0;
  all.bottom = std::min(static_cast<int>(scale * kStatusHeight), window_height / 2);
  all.width = std::max(0, window_width - all.left);
  all.height = std::max(0, window_height - all.bottom);
  if (!with_slices) return areas;
  const int gap = std::max(1, static_cast<int>(2.0 * scale));
  const int width = std::max(0, (all.width - gap) / 2),
            height = std::max(0, (all.height - gap) / 2);
  const int right = all.left + all.width - width, top = all.bottom + all.height - height;
  areas.slices = {SceneArea{right, all.bottom, width, height},
                  SceneArea{all.left, all.bottom, width, height},
                  SceneArea{all.left, top, width, height}};
  areas.scene = {right, top, width, height};
  return areas;
}

}  // namespace isobrick
