// Dark lines where a surface ends before another one, or before the background.
#pragma once

#include "isobrick/viewer/render/gl_handle.h"
#include "isobrick/viewer/render/gl_targets.h"
#include "isobrick/viewer/render/scene_view.h"

namespace isobrick {

// Lines are found in the depths of the picture, where these leave the plane of a pixel; they are as
// wide as others of the frame (SceneFrame::pixel_scale).
class OutlinePass {
 public:
  // Throws Error if the driver refuses the shader.
  OutlinePass();

  // How far it looks around a pixel, in pixels (scene_view.h).
  static int neighbourhoodOf(const SceneFrame& frame);
  // Over what was drawn into the sampled frame of the targets so far.
  void draw(const GlTargets& targets, const SceneView& view) const;

 private:
  GlProgram program_;
  GlVertexArray empty_array_;
};

}  // namespace isobrick
