// Pictures of triangle meshes without a window or an X server.
//
//   OffscreenRenderer renderer;
//   RenderOptions options;
//   options.color_by_level = true;
//   writeImage("bone.png", renderer.render({positions, normals, triangles, levels}, options));
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <glm/vec3.hpp>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "isobrick/viewer/image.h"
#include "isobrick/viewer/picture_notes.h"

namespace isobrick {

struct SceneLattice;  // viewer/stream/surface_chunk.h
struct SurfaceChunk;

// A view of a mesh that the caller owns and leaves alone during render().
struct RenderMesh {
  // World units, finite. Positions that no triangle uses are framed too.
  std::span<const glm::vec3> positions;
  // Unit, outward: one per position. Empty: each triangle is a flat facet.
  std::span<const glm::vec3> normals;
  // 3 indices into positions per triangle, counter-clockwise seen from the outside.
  std::span<const std::uint32_t> triangles;
  // The pyramid level of each triangle. Empty: all are of level 0.
  std::span<const std::uint8_t> triangle_levels;
};

// An axis-aligned box in world units; empty if a lower bound exceeds the upper.
struct RenderBox {
  glm::vec3 lower{0.0f};  // bounds
  glm::vec3 upper{0.0f};  // likewise
};

// A camera that orbits the mesh, at the distance at which all of it just fits into the picture. In
// the patient's coordinates of medical volumes (LPS: +x left, +y back, +z head) azimuth 0 and
// elevation 0 is a portrait: the face, with its left to the right.
struct OrbitCamera {
  // Degrees. Positive azimuths lie to the right around `up`; 180 sees the back.
  double azimuth = 25.0;
  // Degrees; positive sees the mesh from above, 90 from straight above (azimuth then turns it).
  double elevation = 15.0;
  // Not zero. At azimuth 0 the camera looks along +y, or along -z (+z) if `up` is close to +y (-y).
  glm::dvec3 up{0.0, 0.0, 1.0};
  // Frames this box instead of the mesh: the same view for several meshes, or a close-up. The mesh
  // is drawn outside of it too.
  std::optional<RenderBox> box;
};

// A camera that is placed explicitly. Lengths in world units. `eye` and `target` differ, and `up`
// is not parallel to the view; render() throws Error otherwise.
struct LookAtCamera {
  glm::dvec3 eye{0.0};           // its place
  glm::dvec3 target{0.0};        // the middle of the picture
  glm::dvec3 up{0.0, 0.0, 1.0};  // points up in it
};

// Colours are sRGB values 0..1, as a colour picker shows them.
struct RenderOptions {
  int width = 1024;            // pixels, 1 .. kMostPictureSide
  int height = 1024;           // pixels, likewise
  double vertical_fov = 30.0;  // degrees, 1 .. 150

  OrbitCamera orbit;                    // the eye's place
  std::optional<LookAtCamera> look_at;  // used instead of `orbit` if given

  // Colours each triangle by its level (levelColor) instead of surface_color.
  bool color_by_level = false;
  // Colours chunks by the components of their vertices (packComponent); comes before the level.
  bool color_by_component = false;
  // Draws the triangles' edges over the shaded surface, a pixel wide and anti-aliased. They fade
  // if triangles get as small as the lines, so that a dense mesh does not drown in them.
  bool wireframe = false;
  // Surfaces shade each other by their depths in the picture: darker in hollows.
  bool ambient_occlusion = false;
  bool shadow = false;  // opaque surfaces keep the key light from each other
  // The outline of this sphere is drawn over the picture as a thin circle, hidden by nothing.
  std::optional<SphereOutline> focus_sphere;

  // Surfaces seen from the outside.
  glm::vec3 surface_color{0.90f, 0.86f, 0.79f};
  // Surfaces seen from the inside (clockwise triangles): dark and warm, unlike any levelColor, so
  // that an inside-out mesh cannot be mistaken for a good one.
  glm::vec3 back_color{0.46f, 0.20f, 0.13f};
  glm::vec3 background_top{0.36f, 0.38f, 0.41f};     // behind the mesh
  glm::vec3 background_bottom{0.16f, 0.17f, 0.19f};  // the same at the bottom

  // Drawn over the picture. The scale bar measures at the target of `look_at`, or in the middle of
  // the mesh. Without a font, which is a choice of the build, render() throws Error for any of
  // them.
  PictureNotes notes;
};

// Owns an OpenGL 4.5 context that draws into memory, on the GPU if Mesa drives one, and with
// Mesa's software renderer otherwise. Making one takes some 0.1 s; use it for many pictures.
//
// Threads: one call at a time per renderer, from any thread; different renderers are independent.
// A call leaves the calling thread without a current EGL context.
// Memory: pictures are drawn in tiles, about 80 bytes a pixel of one (at most 0.4 GB), and 12 bytes
// a pixel of what is returned. The surface's chunks (20 bytes a vertex and 12 a triangle) are kept
// while they are drawn.
class OffscreenRenderer {
 public:
  // Throws Error that says what to install if no context can be made.
  OffscreenRenderer();
  ~OffscreenRenderer();
  OffscreenRenderer(const OffscreenRenderer&) = delete;
  OffscreenRenderer& operator=(const OffscreenRenderer&) = delete;

  // Draws the mesh with 4 samples a pixel. Lines and edges are averaged in linear light. The same
  // call gives the same picture on the same machine. An empty mesh gives the background.
  // Throws Error for sizes and cameras outside their ranges and if memory does not suffice.
  Image render(const RenderMesh& mesh, const RenderOptions& options);
  // The same for a surface that comes in chunks, as an extraction makes them. Each is freed once it
  // was sent, so that no chunk is held twice.
  Image render(std::vector<SurfaceChunk> chunks, const SceneLattice& lattice,
               const RenderOptions& options);
  // Pictures that need not fit into memory, from top to bottom: `take` is called with a few rows
  // after the other of the picture of options[picture], whose width they have, and with the part of
  // it that they complete, 0 .. 1.
  void renderRows(std::vector<SurfaceChunk> chunks, const SceneLattice& lattice,
                  std::span<const RenderOptions> options,
                  const std::function<void(std::size_t picture, Image rows, double share)>& take);

  // Greatest width and height of a picture in pixels.
  int greatestSize() const { return kMostPictureSide; }
  // The device that draws, for logs: for instance "llvmpipe (LLVM 15.0.6, 256 bits)".
  const std::string& deviceName() const;

 private:
  class Context;
  std::unique_ptr<Context> context_;
};

}  // namespace isobrick
