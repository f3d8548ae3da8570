#include "isobrick/viewer/render/outline_pass.h"

#include <algorithm>
#include <cmath>

#include "isobrick/viewer/render/scene_shaders.h"

namespace isobrick {
namespace {

constexpr double kLineWidth = 1.0;  // pixels to each side

int widthIn(const SceneFrame& frame) {
  return std::max(1, static_cast<int>(std::lround(kLineWidth * frame.pixel_scale)));
}

}  // namespace

OutlinePass::OutlinePass() : program_(makeOutlineProgram()), empty_array_(GlVertexArray::make()) {}

int OutlinePass::neighbourhoodOf(const SceneFrame& frame) {
  return frame.outlines ? widthIn(frame) : 0;
}

// The background stays as it is, so a line lies on the surface that it ends.
void OutlinePass::draw(const GlTargets& targets, const SceneView& view) const {
  targets.resolve(GL_DEPTH_BUFFER_BIT);
  glBindTextureUnit(0, targets.resolvedDepth());
  glBindVertexArray(*empty_array_);
  setPlacesOfPixels(program_, view);
  setUniform(program_, "reach", 1.0f);
  setUniform(program_, "width", widthIn(view.frame));
  targets.multiply([] { glDrawArrays(GL_TRIANGLES, 0, 3); });
}

}  // namespace isobrick
