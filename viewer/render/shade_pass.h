// How opaque surfaces shade each other: by shadows in the key light, which stands beside the
// camera, and in hollows, by ambient occlusion. Both look into pictures of depths.
#pragma once

#include <glm/mat3x3.hpp>
#include <glm/vec3.hpp>
#include <glm/vec4.hpp>
#include <optional>

#include "isobrick/viewer/render/chunk_draws.h"
#include "isobrick/viewer/render/gl_chunks.h"
#include "isobrick/viewer/render/gl_device.h"
#include "isobrick/viewer/render/gl_handle.h"
#include "isobrick/viewer/render/gl_targets.h"
#include "isobrick/viewer/render/scene_renderer.h"
#include "isobrick/viewer/render/scene_view.h"

namespace isobrick {

// Draws a picture of the depths of opaque surfaces, without samples.
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

// From the eye's coordinates to those of the light, and to its picture of depths.
struct ShadowView {
  glm::mat3 rotation{1.0f};
  glm::vec3 offset{0.0f};
  glm::vec4 projection{1.0f};  // as SceneView::projection, of parallel rays
  float texel = 0.0f;          // of the picture, world units
};

// Depths seen from the light (Williams 1978): a point behind them lies in the shadow. Its edge is
// soft, as 25 neighbours are asked (Reeves et al. 1987).
class ShadowPass {
 public:
  // Throws Error if the driver refuses the shader.
  explicit ShadowPass(const GlDevice& device);

  // Draws the depths of the frame's opaque surfaces, unless they are still those of this very
  // frame: all tiles of a picture have the same. Binds another frame buffer.
  void draw(const GlChunks& chunks, const SceneView& view);
  // The memory of these depths may be lacking.
  void forget() { drawn_.reset(); }
  const ShadowView& seen() const { return seen_; }
  // With filters that compare.
  GLuint depths() const { return depths_.depths(); }

 private:
  const GlDevice& device_;
  DepthPass depths_;
  ShadowView seen_;
  std::optional<SceneFrame> drawn_;
};

// In a large picture, whose surfaces shade each other over many pixels, what is around a pixel is
// looked up in coarser depths, so that a tile of it has to know as much as a whole small picture.
// Comes before slices and caps, whose colours stand for values.
class OcclusionPass {
 public:
  explicit OcclusionPass(bool is_software);

  // How far it looks around a pixel, in pixels (scene_view.h).
  static int neighbourhoodOf(const SceneFrame& frame);
  // Draws the coarser depths, if the picture is large; binds another frame buffer. Comes first.
  void drawAround(const GlChunks& chunks, const SceneView& view);
  // Shades what the sampled frame shows.
  void draw(const GlTargets& targets, const SceneView& view);

 private:
  GlProgram occlusion_program_, shade_program_;
  DepthPass around_;
  SceneFrame coarse_;      // the picture of these depths
  PixelBox around_drawn_;  // and what of it was drawn
  GlVertexArray empty_array_;
  GlTexture openness_;
  GlFramebuffer openness_frame_;
  int width_ = 0, height_ = 0;  // of openness_
};

}  // namespace isobrick
