// Surfaces: opaque ones, and those that are seen through.
#pragma once

#include <array>

#include "isobrick/viewer/render/chunk_draws.h"
#include "isobrick/viewer/render/gl_chunks.h"
#include "isobrick/viewer/render/gl_device.h"
#include "isobrick/viewer/render/gl_handle.h"
#include "isobrick/viewer/render/layer_pass.h"
#include "isobrick/viewer/render/scene_shaders.h"
#include "isobrick/viewer/render/scene_view.h"
#include "isobrick/viewer/render/shade_pass.h"

namespace isobrick {

// Draws into the bound framebuffer, with depth.
class SurfacePass {
 public:
  // Throws Error if the driver refuses the shaders.
  explicit SurfacePass(const GlDevice& device);

  // Finds what may be seen; comes first. `shadow`: that of the frame; null: there is none.
  void begin(const GlChunks& chunks, const SceneView& view, const ShadowPass* shadow);
  void drawOpaque(const GlChunks& chunks, const SceneView& view);
  // Where those that are seen through may be in the picture; nowhere: there are none.
  BufferBox layerPixels(const SceneView& view) const;
  // The fragments of these, for LayerPass, within some pixels.
  void drawLayers(const GlChunks& chunks, const SceneView& view, const LayerPass& layers,
                  const BufferBox& band);

  const DrawCounts& counts() const { return draws_.counts(); }

 private:
  void use(const GlProgram& program, const SceneView& view) const;
  GlProgram& programOf(const SurfaceProgramKind& kind);

  std::array<GlProgram, 8> programs_;  // of each kind, made when it is first needed
  ChunkDraws draws_;
  const ShadowPass* shadow_ = nullptr;  // of this frame
};

}  // namespace isobrick
