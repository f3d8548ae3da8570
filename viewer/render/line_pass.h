// Lines over a scene, and the sphere of interest.
#pragma once

#include <glm/vec4.hpp>
#include <vector>

#include "isobrick/viewer/render/gl_handle.h"
#include "isobrick/viewer/render/scene_view.h"

namespace isobrick {

class LinePass {
 public:
  LinePass();

  // Hidden by surfaces in front of them.
  void drawSegments(const SceneView& view) const;
  // Its inside, if it is filled, and its outline, over everything.
  void drawSphere(const SceneView& view) const;

 private:
  void drawRibbon(const std::vector<glm::vec4>& ribbon, const glm::vec3& color, float half_width,
                  float casing) const;

  GlProgram line_program_, sphere_program_;
  GlVertexArray line_array_, empty_array_;
  GlBuffer line_buffer_;
};

}  // namespace isobrick
