// The interface between a scene and its renderer: OpenGL, in a window or without one, or none.
#pragma once

#include <cstdint>
#include <glm/vec2.hpp>
#include <optional>
#include <string>

#include "isobrick/viewer/image.h"
#include "isobrick/viewer/render/scene_frame.h"
#include "isobrick/viewer/stream/chunk_store.h"
#include "isobrick/viewer/stream/slice_store.h"
#include "isobrick/viewer/stream/surface_chunk.h"

namespace isobrick {

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
  // For everything that is kept.
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
