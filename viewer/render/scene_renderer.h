// The interface between a scene and its renderer: OpenGL, in a window or without one, or none.
#pragma once

#include <cstddef>
#include <cstdint>
#include <glm/vec2.hpp>
#include <optional>
#include <vector>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/image.h"
#include "isobrick/viewer/render/scene_frame.h"

namespace isobrick {

// The most of a chunk that one call uploads while frames go on: a fraction of a millisecond.
inline constexpr std::size_t kPieceBytes = std::size_t{256} << 10;

// The driver was reset: all that was kept is gone, and nothing is drawn any longer. Any call may
// throw it; release() never does. The owner makes another renderer.
class RendererLost : public Error {
 public:
  RendererLost() : Error("the graphics driver was reset") {}
};

// The graphics card has no memory left for what was asked; all that was kept stays.
class NoGraphicsMemory : public Error {
 public:
  using Error::Error;
};

// Keeps chunks and slices until they are released, and draws frames of them. Used by one thread.
// Numbers are not given twice.
class SceneRenderer {
 public:
  virtual ~SceneRenderer() = default;

  // Makes room for a chunk, without its bytes. Throws NoGraphicsMemory.
  virtual ChunkId reserve(const SurfaceChunk& chunk) = 0;
  // Copies some of the bytes of that chunk, at most kPieceBytes: its vertices, then its triangles.
  // Never waits; false: not now, but in the next frame.
  virtual bool uploadPiece(ChunkId id, const SurfaceChunk& chunk, std::size_t begin,
                           std::size_t bytes) = 0;
  // After the last piece of a frame.
  virtual void endUploads() = 0;
  // All of a chunk at once. Throws as reserve().
  virtual ChunkId upload(const SurfaceChunk& chunk) = 0;
  virtual void release(ChunkId chunk) = 0;
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
  // Greatest width and height of a frame in pixels.
  virtual int greatestSize() const = 0;
};

}  // namespace isobrick
