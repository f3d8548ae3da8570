// The seam between what is shown and what draws it: OpenGL, in a window or without one, or nothing.
#pragma once

#include <cstdint>
#include <glm/vec2.hpp>
#include <optional>
#include <vector>

#include "isobrick/viewer/image.h"
#include "isobrick/viewer/render/scene_frame.h"

namespace isobrick {

// Keeps chunks and slices until they are released, and draws frames of them. Used by one thread.
// Numbers are not given twice.
class SceneRenderer {
 public:
  virtual ~SceneRenderer() = default;

  // Throws Error where there is no memory for it.
  virtual ChunkId upload(const SurfaceChunk& chunk) = 0;
  virtual void release(ChunkId chunk) = 0;
  // What is kept of a chunk: its vertices, triangles, origin, level and surface. Slow.
  virtual SurfaceChunk download(ChunkId chunk) const = 0;
  virtual SliceId uploadSlice(const SliceImage& image) = 0;
  virtual void releaseSlice(SliceId slice) = 0;
  // Of everything that is kept.
  virtual std::uint64_t bytesKept() const = 0;

  // Draws a frame of at least one pixel. Everything that it names is kept here.
  virtual void draw(const SceneFrame& frame) = 0;

  // Of the frame that was drawn last: how far along the camera's forward axis the surface under a
  // pixel (from the top left) lies; none where there is only background.
  virtual std::optional<double> distanceAt(const glm::dvec2& pixel) = 0;
  // Its colours; with alpha where it was transparent.
  virtual Image picture() = 0;
  // How far along the camera's forward axis what is seen at each pixel lies, rows from top to
  // bottom; infinity where there is only background.
  virtual std::vector<float> distances() = 0;
  // Greatest width and height of a frame in pixels.
  virtual int greatestSize() const = 0;
};

}  // namespace isobrick
