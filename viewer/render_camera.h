// Where the eye stands and what it sees: the arithmetic of cameras, without OpenGL.
#pragma once

#include <glm/vec3.hpp>
#include <span>

#include "isobrick/viewer/offscreen_renderer.h"

namespace isobrick {

// In double precision, and the mesh is sent relative to the eye: a scanner's origin can be far away
// compared with a voxel.
struct PlacedCamera {
  glm::dvec3 eye{0.0};
  glm::dvec3 right{1.0, 0.0, 0.0};  // right, up and forward are orthonormal
  glm::dvec3 up{0.0, 0.0, 1.0};
  glm::dvec3 forward{0.0, 1.0, 0.0};
  double half_width = 1.0;   // of the picture at distance 1
  double half_height = 1.0;  // likewise
};

// The camera of `options`, seeing a picture of the options' shape. An OrbitCamera frames its box,
// or the mesh's positions where it has none; with nothing to frame the eye stays at the origin.
// Sizes and field of view must be in their ranges. Throws Error where eye and target coincide, `up`
// is zero or parallel to the view, or the eye, a direction or an angle is not finite.
PlacedCamera placeCamera(const RenderOptions& options, const RenderMesh& mesh);

// The least box that holds the positions; an empty one (RenderBox) where there are none.
RenderBox boundsOf(std::span<const glm::vec3> positions);

// Clip planes that just hold the box, for the sake of depth resolution; `near` is kept away from 0
// where the eye is inside the box or the box behind it.
struct DepthRange {
  double near = 0.1;
  double far = 1.0;
};
DepthRange depthRangeOf(const RenderBox& box, const PlacedCamera& camera);

}  // namespace isobrick
