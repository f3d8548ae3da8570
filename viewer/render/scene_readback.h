// Reading back what a renderer keeps and drew.
#pragma once

#include "isobrick/viewer/image.h"
#include "isobrick/viewer/stream/chunk_store.h"
#include "isobrick/viewer/stream/surface_chunk.h"

namespace isobrick {

// Every call waits until the card has drawn, so none is for a frame of a window (depth_readback.h).
// Used by the thread of the renderer. Throws Error if there is no memory for it, and RendererLost.
class SceneReadback {
 public:
  virtual ~SceneReadback() = default;

  // The colours of the frame that was drawn last; with alpha if it was transparent.
  virtual Image picture() = 0;
  // The kept parts of a chunk: its vertices, triangles, origin, level and surface. Slow.
  virtual SurfaceChunk download(ChunkId chunk) const = 0;
};

}  // namespace isobrick
