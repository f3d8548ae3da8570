// A frame's camera as shaders take it, and what lies in its picture.
#pragma once

#include <glm/mat3x3.hpp>
#include <glm/vec3.hpp>
#include <glm/vec4.hpp>
#include <span>
#include <vector>

#include "isobrick/viewer/placed_camera.h"
#include "isobrick/viewer/render/gl_handle.h"
#include "isobrick/viewer/render/scene_frame.h"
#include "isobrick/viewer/stream/surface_chunk.h"

namespace isobrick {

// Pixels of a picture from its lower left corner; empty if an end is not behind its begin.
struct PixelBox {
  int left = 0, bottom = 0, right = 0, top = 0;  // the last two are left out

  bool isEmpty() const { return right <= left || top <= bottom; }
  void include(const PixelBox& other);
};

// Points in the lattice with dot(plane, (point, 1)) >= 0 for all of these planes.
using LatticePlanes = std::vector<glm::dvec4>;

// False only if the box lies wholly on the other side of one of them.
bool mayBeInside(const LatticePlanes& planes, const glm::dvec3& lower, const glm::dvec3& upper);

// Shared by all draw calls of a frame, which outlives it. Eye coordinates: the eye at the origin,
// +x right, +y up, -z ahead.
struct SceneView {
  explicit SceneView(const SceneFrame& frame);

  // In eye coordinates.
  glm::vec4 planeSeen(const SceneClipPlane& plane) const;
  glm::vec3 eyePosition(const glm::dvec3& world) const {
    return glm::vec3(to_eye * (world - frame.camera.eye));
  }
  // In the lattice: dot(normal, world) - offset.
  glm::dvec4 inLattice(const SceneClipPlane& plane) const;
  // The sides of the picture, and the clip planes.
  LatticePlanes planesOfPicture() const { return planesOfRows(0, frame.height); }
  // The same of some rows of it, from below, the last one left out.
  LatticePlanes planesOfRows(int begin, int end) const;
  // All pixels that the convex hull of points may touch, in world units.
  PixelBox pixelsOf(std::span<const glm::dvec3> hull) const;

  const SceneFrame& frame;
  DepthRange range;
  DepthProjection depth;
  glm::dmat3 to_eye;     // world axes to eye axes
  glm::vec4 projection;  // x and y scale, depth scale and offset
  SnappedEye snapped;
  std::vector<glm::vec4> clip_planes;  // eye coordinates
};

// Uses the program, and sets projection, orthographic, clip_planes, clip_count. `uncut_plane`: the
// plane that does not cut.
void useProgram(const GlProgram& program, const SceneView& view, int uncut_plane = -1);

glm::vec3 linearColor(const glm::vec3& srgb);

}  // namespace isobrick
