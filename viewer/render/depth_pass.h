// The depths of opaque surfaces alone.
#pragma once

#include "isobrick/viewer/render/chunk_draws.h"
#include "isobrick/viewer/render/gl_chunks.h"
#include "isobrick/viewer/render/gl_handle.h"
#include "isobrick/viewer/render/scene_view.h"

namespace isobrick {

// Draws a picture of depths, without samples.
class DepthPass {
 public:
  // Throws Error if the driver refuses the shader.
  explicit DepthPass(bool is_software);

  // Into memory of the size of what the view draws, which grows or shrinks to that; binds it.
  void draw(const GlChunks& chunks, const SceneView& view);
  // A texture, without filters; of the last draw().
  GLuint depths() const { return *depths_; }

 private:
  void resize(int width, int height);

  GlProgram program_;
  ChunkDraws draws_;
  int width_ = 0, height_ = 0;
  GlTexture depths_;
  GlFramebuffer frame_;
};

}  // namespace isobrick
