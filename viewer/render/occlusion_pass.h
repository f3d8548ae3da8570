// Ambient occlusion: surfaces shade each other by the depths of the picture.
#pragma once

#include "isobrick/viewer/render/gl_handle.h"
#include "isobrick/viewer/render/gl_targets.h"
#include "isobrick/viewer/render/scene_view.h"

namespace isobrick {

// Comes before slices and caps, whose colours stand for values.
class OcclusionPass {
 public:
  OcclusionPass();

  // How far it looks around a pixel, in pixels (scene_view.h).
  static int neighbourhoodOf(const SceneFrame& frame);
  // Shades what the sampled frame shows.
  void draw(const GlTargets& targets, const SceneView& view);

 private:
  GlProgram occlusion_program_, shade_program_;
  GlVertexArray empty_array_;
  GlTexture openness_;
  GlFramebuffer openness_frame_;
  int width_ = 0, height_ = 0;  // of openness_
};

}  // namespace isobrick
