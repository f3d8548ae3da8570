// The flat views of the volume beside the scene: which place of a slice each pixel shows, and what
// moves them. No window, no OpenGL.
#pragma once

#include <array>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

#include "isobrick/viewer/state/view_state.h"

namespace isobrick {

// One flat view: a slice across one axis of the voxels, seen so that pixels are square in the
// world. As radiologists look at a patient (world axes to the left, to the back and up): across z
// from below with the front at the top, across y from the front, across x from the left side with
// the front at the left. A volume that lies obliquely in the world is seen along its nearest axes.
struct SliceFrame {
  int axis = 2;                        // of the voxels, across which it is cut
  glm::dvec3 center{0.0};              // voxel index that is in the middle of all three views
  glm::dvec3 corner{0.0};              // voxel index at the upper left corner of the picture
  glm::dvec3 right{0.0};               // voxels to the next pixel
  glm::dvec3 down{0.0};                // voxels to the pixel below
  std::array<const char*, 4> sides{};  // the world's axes at left, right, top and bottom: "-x"

  bool operator==(const SliceFrame&) const = default;

  // Pixels from the upper left corner of the picture. The slice's own position counts nothing.
  glm::dvec3 indexAt(const glm::dvec2& pixel) const {
    return corner + right * pixel.x + down * pixel.y;
  }
  glm::dvec2 pixelOf(const glm::dvec3& index) const;
};

inline constexpr int kSliceViews = 3;

// The frame of the view along the world's axis `view` (0 .. 2) in a picture of `size` pixels.
SliceFrame sliceFrame(const ViewState& state, const ViewVolume& volume, int view,
                      const glm::dvec2& size);

// The other two slices go through this place, given as a voxel index.
void crossAt(const SliceFrame& frame, const glm::dvec3& index, ViewState& state);
// By so many voxels.
void stepSlice(const SliceFrame& frame, double steps, ViewState& state);
// The place under `pixel` stays there.
void zoomSlices(const SliceFrame& frame, const glm::dvec2& pixel, double factor, ViewState& state);
// What was under the pixel `from` comes to the pixel `to`.
void moveSlices(const SliceFrame& frame, const glm::dvec2& from, const glm::dvec2& to,
                ViewState& state);
// The window of values, as radiologists drag it: to the right wider, upwards brighter. 400 pixels
// are all of the volume's values.
void dragWindow(const glm::dvec2& pixels, const ViewVolume& volume, ViewState& state);

}  // namespace isobrick
