#include "isobrick/viewer/render/outline_pass.h"

#include <algorithm>
#include <cmath>

#include "isobrick/viewer/render/scene_shaders.h"

namespace isobrick {
namespace {
constexpr double kLineWidth = 1.0;  // pixels to each side
}

OutlinePass::OutlinePass() : program_(makeOutlineProgram()), empty_array_(GlVertexArray::make()) {}

// The background stays as it is, so a line lies on the surface that it ends.
void OutlinePass::draw(const GlTargets& targets, const SceneView& view) const {
  targets.resolve(GL_DEPTH_BUFFER_BIT);
  glBindFramebuffer(GL_FRAMEBUFFER, targets.sampledFrame());
  glBindTextureUnit(0, targets.resolvedDepth());
  glBindVertexArray(*empty_array_);
  glEnable(GL_DEPTH_TEST);
  glDepthMask(GL_FALSE);
  glDepthFunc(GL_LESS);  // passes everything that is not background
  glEnable(GL_BLEND);
  glBlendFuncSeparate(GL_ZERO, GL_SRC_COLOR, GL_ZERO, GL_ONE);
  glUseProgram(*program_);
  setUniform(program_, "projection", view.projection);
  setUniform(program_, "orthographic", static_cast<int>(view.frame.camera.orthographic));
  setUniform(program_, "reach", 1.0f);
  setUniform(program_, "width",
             std::max(1, static_cast<int>(std::lround(kLineWidth * view.frame.pixel_scale))));
  glDrawArrays(GL_TRIANGLES, 0, 3);
  glDisable(GL_BLEND);
  glDepthFunc(GL_GREATER);
  glDepthMask(GL_TRUE);
}

}  // namespace isobrick
