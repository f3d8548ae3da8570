// The outline of a sphere in a picture, as triangles.
#pragma once

#include <glm/vec3.hpp>
#include <vector>

#include "isobrick/viewer/placed_camera.h"
#include "isobrick/viewer/sphere_outline.h"

namespace isobrick {

// The outline of a sphere as a ribbon of triangles (3 corners each) that reaches `reach` pixels to
// both sides of the line: x and y in normalised device coordinates, and z the distance from the
// line's middle in pixels. The part behind the eye is left out. Empty if the eye is inside the
// sphere or the radius is not positive. The picture is width x height pixels.
std::vector<glm::vec3> outlineRibbon(const SphereOutline& sphere, const PlacedCamera& camera,
                                     int width, int height, double reach);

}  // namespace isobrick
