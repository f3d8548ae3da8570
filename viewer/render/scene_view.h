// A frame's camera as shaders take it, and what lies in its picture, or in a tile of that.
//
// A pass that looks at the neighbours of a pixel has two duties, so that a picture that is drawn in
// tiles equals one that is drawn in one piece:
// - It says how far it looks, in pixels: a static function neighbourhoodOf(const SceneFrame&). The
//   greatest one of all passes is the margin that each tile is drawn with (GlSceneRenderer).
// - Its shader takes places and patterns of pixels in the whole picture, not in the frame buffer:
//   setPlacesOfPixels(), and `first_pixel` in the shader.
// Sizes and reaches follow from SceneFrame::width and height, those of the whole picture.
#pragma once

#include <glm/mat3x3.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <glm/vec4.hpp>
#include <span>
#include <vector>

#include "isobrick/viewer/placed_camera.h"
#include "isobrick/viewer/render/gl_handle.h"
#include "isobrick/viewer/render/scene_renderer.h"
#include "isobrick/viewer/stream/surface_chunk.h"

namespace isobrick {

// Pixels of the frame buffer from its lower left corner; empty if an end is not behind its begin.
struct BufferBox {
  int left = 0, bottom = 0, right = 0, top = 0;  // the last two are left out

  bool isEmpty() const { return right <= left || top <= bottom; }
  void include(const BufferBox& other);
};

// Points in the lattice with dot(plane, (point, 1)) >= 0 for all of these planes.
using LatticePlanes = std::vector<glm::dvec4>;

// False only if the box lies wholly on the other side of one of them.
bool mayBeInside(const LatticePlanes& planes, const glm::dvec3& lower, const glm::dvec3& upper);

// Shared by all draw calls of a frame, which outlives it. Eye coordinates: the eye at the origin,
// +x right, +y up, -z ahead.
struct SceneView {
  // All of the picture, or the pixels of a box of it, which has the size of the frame buffer.
  explicit SceneView(const SceneFrame& frame);
  SceneView(const SceneFrame& frame, const PixelBox& drawn);

  // In eye coordinates.
  glm::vec4 planeSeen(const SceneClipPlane& plane) const;
  glm::vec3 eyePosition(const glm::dvec3& world) const {
    return glm::vec3(to_eye * (world - frame.camera.eye));
  }
  // In the lattice: dot(normal, world) - offset.
  glm::dvec4 inLattice(const SceneClipPlane& plane) const;
  // The sides of what is drawn, and the clip planes.
  LatticePlanes planesDrawn() const { return planesOfRows(0, drawn.height); }
  // The same of some rows of what is drawn, from below, the last one left out.
  LatticePlanes planesOfRows(int begin, int end) const;
  // All that is drawn and that the convex hull of points, in world units, may touch.
  BufferBox pixelsOf(std::span<const glm::dvec3> hull) const;
  // In the coordinates of the viewport that useViewport() sets: a place in pixels from the middle
  // of the picture, to the right and up, as a card keeps it.
  glm::dvec2 inPort(const glm::dvec2& pixel) const;
  // A viewport larger than what is drawn, as triangles that reach out of a viewport are cut.
  void useViewport() const;
  // The lower left pixel that is drawn, from the lower left corner of the picture.
  glm::ivec2 firstPixel() const;

  const SceneFrame& frame;
  PixelBox drawn;
  glm::dvec2 port_middle{0.0};  // pixels from the middle of the picture
  int half_port = 1;            // pixels, a power of two
  DepthRange range;
  DepthProjection depth;
  glm::dmat3 to_eye;     // world axes to eye axes
  glm::vec4 projection;  // x and y scale, depth scale and offset
  SnappedEye snapped;
  std::vector<glm::vec4> clip_planes;  // eye coordinates
};

// Uses the program, and sets the uniforms of project(), and the viewport. `uncut_plane`: the plane
// that does not cut.
void useProgram(const GlProgram& program, const SceneView& view, int uncut_plane = -1);

// Uses a program that reads the depths of neighbours, and sets its projection, orthographic,
// first_pixel and picture_size, and a viewport of just what is drawn.
void setPlacesOfPixels(const GlProgram& program, const SceneView& view);

glm::vec3 linearColor(const glm::vec3& srgb);

}  // namespace isobrick
