// The interface between a scene and its renderer: OpenGL, in a window or without one, or none.
#pragma once

#include <cstddef>
#include <cstdint>
#include <glm/vec2.hpp>
#include <optional>
#include <vector>

#include "isobrick/viewer/image.h"
#include "isobrick/viewer/render/scene_frame.h"
#include "isobrick/viewer/stream/chunk_store.h"
#include "isobrick/viewer/stream/slice_image.h"

namespace isobrick {

// Keeps chunks and slices until they are released, and draws frames of them. Used by one thread.
// Numbers are not given twice.
class SceneRenderer : public ChunkStore {
 public:
  // All of a chunk at once. Throws as reserve().
  virtual ChunkId upload(const SurfaceChunk& chunk) = 0;
  // The kept parts of a chunk: its vertices, triangles, origin, level and surface. Slow.
  virtual SurfaceChunk download(ChunkId chunk) const = 0;
  // Makes room for a slice of so many values. Throws NoGraphicsMemory.
  virtual SliceId reserveSlice(int width, int height) = 0;
  // Copies `count` rows from `first` on of the image that the slice was reserved for.
  virtual void uploadRows(SliceId slice, const SliceImage& image, int first, int count) = 0;
  // All of a slice at once.
  SliceId uploadSlice(const SliceImage& image) {
    const SliceId id = reserveSlice(image.width, image.height);
    uploadRows(id, image, 0, image.height);
    return id;
  }
  virtual void releaseSlice(SliceId slice) = 0;
  // For everything that is kept.
  virtual std::uint64_t bytesKept() const = 0;

  // Draws a frame of at least one pixel. Everything that it names is kept here. Throws
  // NoGraphicsMemory if there is none for a picture of its size.
  virtual void draw(const SceneFrame& frame) = 0;

  // For the frame that was drawn last: the distance along the camera's forward axis of the surface
  // under a pixel (from the top left); none if there is only background.
  virtual std::optional<double> distanceAt(const glm::dvec2& pixel) = 0;
  // Its colours; with alpha if it was transparent.
  virtual Image picture() = 0;
  // The distances along the camera's forward axis at each pixel, rows from top to bottom; infinity
  // for background.
  virtual std::vector<float> distances() = 0;
  // The processor draws: what a card does at no cost takes time.
  virtual bool isSoftware() const = 0;
  // Greatest width and height of a frame in pixels.
  virtual int greatestSize() const = 0;
};

}  // namespace isobrick
