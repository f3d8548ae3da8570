// Handles in the scene that the user drags: the focus along three axes, its sphere's radius, clip
// planes along their normals, and a cube whose faces are views along the axes.
#pragma once

#include <array>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <optional>
#include <vector>

#include "isobrick/viewer/state/view_state.h"

namespace isobrick {

// The picture that the user sees. `scale` is how many of its pixels are one of an ordinary screen.
struct PictureSize {
  glm::dvec2 pixels{1.0, 1.0};
  double scale = 1.0;
};

// An arrow, along which the user moves its object.
struct SceneHandle {
  enum class Kind { kFocus, kRadius, kClipPlane };
  Kind kind = Kind::kFocus;
  int number = 0;                        // the axis of the voxels, or which clip plane
  glm::dvec3 foot{0.0};                  // world
  glm::dvec3 direction{1.0, 0.0, 0.0};   // world, unit
  glm::dvec2 foot_pixel{0.0}, tip{0.0};  // in the picture; the user takes the tip

  bool operator==(const SceneHandle&) const = default;
};

// The pixel that shows a point of the world, which may lie outside of the picture; none behind the
// eye.
std::optional<glm::dvec2> pixelOf(const PlacedCamera& camera, const glm::dvec2& picture,
                                  const glm::dvec3& world);

// Points of the world joined by lines, as a picture shows them: points that are not behind the eye,
// and what of the lines is not.
struct PixelPath {
  std::vector<glm::dvec2> points;
  std::vector<std::array<glm::dvec2, 2>> lines;
};
PixelPath pathOf(const PlacedCamera& camera, const glm::dvec2& picture,
                 const std::vector<glm::dvec3>& world);

// None while the view hides them, or behind the eye. An axis along which the eye looks has none, as
// the user could not see how far it moves.
std::vector<SceneHandle> handlesOf(const ViewState& state, const ViewVolume& volume,
                                   const PictureSize& picture);
// The one whose tip is under the cursor.
std::optional<SceneHandle> handleAt(const std::vector<SceneHandle>& handles,
                                    const glm::dvec2& cursor, double scale);

// The distance that the cursor pulls a handle along its direction, in world units from its foot.
// Nothing if the cursor's ray runs along it.
std::optional<double> pullOf(const SceneHandle& handle, const ViewCamera& camera,
                             const PictureSize& picture, const glm::dvec2& cursor);
// The object of the handle, moved by so many world units from the handle's foot; of a radius, these
// are its length.
void pull(const SceneHandle& handle, double by, const ViewVolume& volume, ViewState& state);

// A face of the cube in the upper right corner of the picture.
struct CubeFace {
  AxisView view = AxisView::kFront;
  std::array<glm::dvec2, 4> corners;  // pixels, around it
  double toward = 0.0;                // how much it faces the eye, 0 .. 1
};
// Those that face the eye, at most three; none in a small picture.
std::vector<CubeFace> cubeFacesOf(const ViewCamera& camera, const PictureSize& picture);
std::optional<AxisView> cubeFaceAt(const std::vector<CubeFace>& faces, const glm::dvec2& cursor);

}  // namespace isobrick
