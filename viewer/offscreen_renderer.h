// Pictures without a window or an X server: of views of a pyramid, and of surfaces that were
// extracted before.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid.h"
#include "isobrick/viewer/image.h"
#include "isobrick/viewer/picture_writer.h"
#include "isobrick/viewer/session/scene_of_view.h"
#include "isobrick/viewer/session/volume_opener.h"
#include "isobrick/viewer/state/view_state.h"
#include "isobrick/viewer/stream/surface_chunk.h"

namespace isobrick {

// How views are drawn: width and height are pixels, `threads` are those of the extraction, with
// `layers` pictures have depth and normals.
struct ViewDrawing {
  int width = 1;
  int height = 1;
  int threads = 1;
  bool layers = false;
  std::vector<OpenedVolume> beside = {};  // of the views; their volumes 1, 2, ...
  bool is_step = false;                   // the volume is one of several in time
  OpenMasks masks = {};                   // of the views' regions
};

// Some rows of the picture of a view, from top to bottom, whose size need not fit into memory.
struct ViewRows {
  std::size_t picture = 0;  // of the view with this number
  PictureShape shape;       // of all of it
  Image rows;
  double share = 1.0;           // of the picture that is drawn, 0 .. 1
  std::uint64_t triangles = 0;  // of the surface
};

// Surfaces of any queries. SurfaceChunk::surface is the place in ViewState::surfaces.
struct DrawableSurface {
  std::vector<SurfaceChunk> chunks;
  ViewVolume volume;                       // its voxels and geometry count
  std::vector<ColoredPieces> pieces = {};  // of each, if they are coloured by them
  std::uint64_t triangles = 0;             // of all

  // Calls f(glm::dvec3) for each vertex, world.
  template <typename F>
  void forEachVertex(F&& f) const {
    const SceneLattice lattice{volume.geometry.indexToWorldMatrix(), volume.geometry.origin};
    for (const SurfaceChunk& chunk : chunks)
      for (const SurfaceVertex& vertex : chunk.vertices)
        f(lattice.toWorld(chunk.origin + glm::dvec3(vertex.position)));
  }
};

// Owns an OpenGL 4.5 context that draws into memory, on the GPU if Mesa drives one, and with
// Mesa's software renderer otherwise. Making one takes some 0.1 s; use it for many pictures.
//
// Threads: one call at a time per renderer, from any thread; different renderers are independent.
// A call leaves the calling thread without a current EGL context.
// Memory: pictures are drawn in tiles, about 80 bytes a pixel of one (at most 0.4 GB).
class OffscreenRenderer {
 public:
  using TakeRows = std::function<void(ViewRows rows)>;

  // Throws Error that says what to install if no context can be made.
  OffscreenRenderer();
  ~OffscreenRenderer();
  OffscreenRenderer(const OffscreenRenderer&) = delete;
  OffscreenRenderer& operator=(const OffscreenRenderer&) = delete;

  // Draws the pictures that `isobrick view` shows of these states when they are as fine as they
  // get: surfaces, slices, caps; parts of a surface that stay from one to the next are made once.
  // Throws Error for a damaged brick and sizes that cannot be drawn, and Cancelled.
  void drawViews(std::shared_ptr<const Pyramid> pyramid, std::span<const ViewState> states,
                 const ViewDrawing& drawing, const CancelFlag& cancel, const TakeRows& take);
  // The same of the surfaces of the states, which are not extracted, but these; without slices and
  // caps. Of a sphere of interest there is the outline. Chunks are freed once they were
  // sent. Throws Error for sizes and fields of view outside their ranges.
  void drawSurface(DrawableSurface surface, std::span<const ViewState> states,
                   const ViewDrawing& drawing, const CancelFlag& cancel, const TakeRows& take);

  // The device that draws, for logs: for instance "llvmpipe (LLVM 15.0.6, 256 bits)".
  const std::string& deviceName() const;

 private:
  class Context;
  std::unique_ptr<Context> context_;
};

}  // namespace isobrick
