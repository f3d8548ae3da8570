// The camera of a picture in a file: from its options to where the eye stands, without OpenGL.
#pragma once

#include <glm/vec3.hpp>
#include <span>

#include "isobrick/viewer/offscreen_renderer.h"
#include "isobrick/viewer/placed_camera.h"

namespace isobrick {

// The camera of `options`, seeing a picture of the options' shape. An OrbitCamera frames its box,
// or the mesh's positions where it has none; with nothing to frame the eye stays at the origin.
// Sizes and field of view must be in their ranges. Throws Error where eye and target coincide, `up`
// is zero or parallel to the view, or the eye, a direction or an angle is not finite.
PlacedCamera placeCamera(const RenderOptions& options, const RenderMesh& mesh);

// The least box that holds the positions; an empty one (RenderBox) where there are none.
RenderBox boundsOf(std::span<const glm::vec3> positions);

}  // namespace isobrick
