// The interface between a scene and its renderer: the content of one picture, as plain data, and
// what draws it: OpenGL, in a window or without one, or none.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/extract/color_map.h"
#include "isobrick/viewer/image.h"
#include "isobrick/viewer/picture_notes.h"
#include "isobrick/viewer/placed_camera.h"
#include "isobrick/viewer/stream/chunk_store.h"
#include "isobrick/viewer/stream/surface_chunk.h"

namespace isobrick {

struct PixelBox {
  int left = 0, top = 0;      // from the upper left corner of the picture
  int width = 0, height = 0;  // pixels

  int right() const { return left + width; }
  int bottom() const { return top + height; }
  bool operator==(const PixelBox&) const = default;
};

struct Background {
  const char* name;
  glm::vec3 top, bottom;  // sRGB, 0..1
};

// For screens, for slides, and for print.
inline constexpr std::array<Background, 3> kBackgrounds{{
    {"dark", {0.36f, 0.38f, 0.41f}, {0.16f, 0.17f, 0.19f}},
    {"light", {0.96f, 0.97f, 0.98f}, {0.78f, 0.80f, 0.83f}},
    {"white", {1.0f, 1.0f, 1.0f}, {1.0f, 1.0f, 1.0f}},
}};

struct SceneSlice {
  SliceId image = 0;
  glm::dvec3 corner{0.0}, across{0.0}, along{0.0};  // world
  // Draws only values of at least the one, or below the other: the inside of a cut surface, or what
  // is not air. With neither of them all values.
  std::optional<double> least_value, below_value;
  // The clip plane that it caps, which then does not cut it: an index of SceneFrame::clip_planes.
  int cap_of = -1;
  double black = 0.0, white = 1.0;  // data units
  double opacity = 1.0;             // below 1 it hides no slice behind it

  bool operator==(const SceneSlice&) const = default;
};

struct SurfaceLook {
  glm::vec3 color{0.90f, 0.86f, 0.79f};  // sRGB
  double opacity = 1.0;

  bool operator==(const SurfaceLook&) const = default;
};

// Points with dot(normal, point) >= offset stay.
struct SceneClipPlane {
  glm::dvec3 normal{1.0, 0.0, 0.0};  // world, unit
  double offset = 0.0;

  bool operator==(const SceneClipPlane&) const = default;
};

struct SceneSegment {
  glm::dvec3 begin{0.0}, end{0.0};  // world

  bool operator==(const SceneSegment&) const = default;
};

struct SceneFrame {
  int width = 1;  // pixels
  int height = 1;
  PlacedCamera camera;
  WorldBox bounds = emptyWorldBox();  // of all that is drawn; near and far come from it
  SceneLattice lattice;

  std::vector<ChunkId> chunks;                       // their vertices' values mean the same
  std::vector<SurfaceLook> surfaces{SurfaceLook{}};  // chunks name theirs by number
  bool color_by_level = false;
  // By the places of components (packComponent); a vertex without one has the surface's colour.
  // Comes before color_by_level and values.
  bool color_by_component = false;
  int first_level = 0;  // the volume's level that the chunks' level 0 is: above 0 for previews
  // Colours by the vertices' values, if they have any: these shares of their range get the ends of
  // the map. Comes before color_by_level.
  std::optional<std::array<double, 2>> value_window;
  // The values are distances to this plane, on its normal's side above 0, and `value_window` is in
  // world units.
  std::optional<SceneClipPlane> value_plane;
  ColorMap color_map = ColorMap::kViridis;
  std::optional<glm::vec3>
      transition_color;  // of cells that join two levels, sRGB; none: as others
  bool wireframe = false;
  bool headlight = false;
  // Of colours by value: that of the first and of the last one, which opacities between them
  // follow. Comes beside that of a surface.
  std::array<double, 2> value_opacity{1.0, 1.0};
  bool shadow = false;  // opaque surfaces keep the key light from each other; not with a headlight
  bool ambient_occlusion = false;  // surfaces shade each other, as if light came from all around
  std::vector<SceneClipPlane> clip_planes;  // at most 6
  std::vector<SceneSlice> slices;
  std::vector<SceneSegment> segments;   // thin lines, hidden by surfaces in front of them
  std::optional<SphereOutline> sphere;  // its outline, over everything
  bool fill_sphere = false;             // and its inside, translucent, seen from outside

  double pixel_scale = 1.0;  // of the width of lines
  bool transparent = false;  // there is no background: colours are premultiplied with alpha
  bool normals = false;      // in place of colours those of the surfaces, world, and nothing else

  // sRGB.
  glm::vec3 back_color{0.46f, 0.20f, 0.13f};
  glm::vec3 background_top{0.36f, 0.38f, 0.41f};
  glm::vec3 background_bottom{0.16f, 0.17f, 0.19f};

  bool isOpaque(std::size_t surface) const {
    const bool by_value = value_window && (value_opacity[0] < 1.0 || value_opacity[1] < 1.0);
    return surfaces[surface].opacity >= 1.0 && !by_value;
  }

  bool operator==(const SceneFrame&) const = default;
};

// The distance along the camera's forward axis of the surface under a pixel; none if there is only
// background.
struct DistanceAnswer {
  std::uint64_t question = 0;
  std::optional<double> distance;
};

// Asked of one frame, answered by the time of a later one: a call that waited would stop the
// interface until the card has drawn. Used by the thread of the renderer.
class DepthReadback {
 public:
  virtual ~DepthReadback() = default;

  // For a pixel (from the top left) of the frame drawn last; returns the question's number. What is
  // drawn later does not change the answer.
  virtual std::uint64_t askDistance(const glm::dvec2& pixel) = 0;
  // The answers that have come, one a call, in the order of the questions; nothing: not yet.
  virtual std::optional<DistanceAnswer> takeDistance() = 0;
};

// Every call waits until the card has drawn, so none is for a frame of a window (DepthReadback).
// Used by the thread of the renderer. Throws Error if there is no memory for it, and RendererLost.
class SceneReadback {
 public:
  virtual ~SceneReadback() = default;

  // The colours of the frame that was drawn last; with alpha if it was transparent.
  virtual Image picture() = 0;
  // The kept parts of a chunk: its vertices, triangles, origin, level and surface. Slow.
  virtual SurfaceChunk download(ChunkId chunk) const = 0;
};

// Keeps chunks and slices until they are released, draws frames of them, and reads these back. Used
// by one thread.
class SceneRenderer : public ChunkStore,
                      public SliceStore,
                      public SceneReadback,
                      public DepthReadback {
 public:
  // All of a chunk at once. Throws as reserve().
  virtual ChunkId upload(const SurfaceChunk& chunk) = 0;
  virtual std::uint64_t bytesKept() const = 0;

  // Draws a frame of at least one pixel. Everything that it names is kept here. Throws
  // NoGraphicsMemory if there is none for a picture of its size.
  virtual void draw(const SceneFrame& frame) = 0;

  // The pixels of a tile of a frame, which may be of any size: those that draw() and picture()
  // give, or would, if they could draw so much (but for the last bit of a few). With `depth`, the
  // picture has the layer, too. The frame drawn last, and reading it back, stay as they are. Throws
  // as draw() and picture() do.
  virtual Image drawTile(const SceneFrame& frame, const PixelBox& tile, bool depth) = 0;
  // Frees the memory that tiles are drawn in.
  virtual void endTiles() = 0;
  // So many pixels around a tile are drawn with it, as they count for its pixels.
  virtual int neighbourhoodOf(const SceneFrame& frame) const = 0;

  // The driver was reset: nothing is kept or drawn any longer. Stays true.
  virtual bool isLost() = 0;
  // The device that draws, for logs: for instance "llvmpipe (LLVM 15.0.6, 256 bits)".
  virtual const std::string& deviceName() const = 0;
  // The processor draws: what a card does at no cost takes time.
  virtual bool isSoftware() const = 0;
  // Greatest width and height of a frame in pixels.
  virtual int greatestSize() const = 0;
};

}  // namespace isobrick
