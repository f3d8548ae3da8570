// Ambient occlusion: surfaces shade each other by the depths of the picture.
#pragma once

#include "isobrick/viewer/pixel_box.h"
#include "isobrick/viewer/render/depth_pass.h"
#include "isobrick/viewer/render/gl_chunks.h"
#include "isobrick/viewer/render/gl_handle.h"
#include "isobrick/viewer/render/gl_targets.h"
#include "isobrick/viewer/render/scene_view.h"

namespace isobrick {

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
