// Surfaces: opaque ones, and those that are seen through.
#pragma once

#include "isobrick/viewer/render/chunk_draws.h"
#include "isobrick/viewer/render/gl_chunks.h"
#include "isobrick/viewer/render/gl_handle.h"
#include "isobrick/viewer/render/scene_view.h"

namespace isobrick {

// Draws into the bound framebuffer, with depth.
class SurfacePass {
 public:
  // Throws Error if the driver refuses the shaders.
  explicit SurfacePass(bool is_software);

  // Finds what may be seen; comes first.
  void begin(const GlChunks& chunks, const SceneView& view);
  void drawOpaque(const GlChunks& chunks, const SceneView& view);
  void drawTranslucent(const GlChunks& chunks, const SceneView& view);

  // Of the frame since begin().
  const DrawCounts& counts() const { return draws_.counts(); }

 private:
  void use(const SceneView& view) const;

  GlProgram program_, wire_program_;
  ChunkDraws draws_;
};

}  // namespace isobrick
