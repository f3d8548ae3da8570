// Reading back what a renderer keeps and drew.
#pragma once

#include <glm/vec2.hpp>
#include <optional>
#include <vector>

#include "isobrick/viewer/image.h"
#include "isobrick/viewer/stream/chunk_store.h"
#include "isobrick/viewer/stream/surface_chunk.h"

namespace isobrick {

// Every call waits until the card has drawn; of the frame that was drawn last. Used by the thread
// of the renderer. Throws Error if there is no memory for it, and RendererLost.
class SceneReadback {
 public:
  virtual ~SceneReadback() = default;

  // The distance along the camera's forward axis of the surface under a pixel (from the top left);
  // none if there is only background.
  virtual std::optional<double> distanceAt(const glm::dvec2& pixel) = 0;
  // The colours; with alpha if the frame was transparent.
  virtual Image picture() = 0;
  // The distances along the camera's forward axis at each pixel, rows from top to bottom; infinity
  // for background.
  virtual std::vector<float> distances() = 0;
  // The kept parts of a chunk: its vertices, triangles, origin, level and surface. Slow.
  virtual SurfaceChunk download(ChunkId chunk) const = 0;
};

}  // namespace isobrick
