#include "isobrick/viewer/render/occlusion_pass.h"

#include <algorithm>
#include <cmath>

#include "isobrick/viewer/render/scene_shaders.h"

namespace isobrick {
namespace {

constexpr float kOcclusionReach = 1.0f / 16;  // of the picture's height

float reachIn(const SceneFrame& frame) {
  return kOcclusionReach * static_cast<float>(frame.height);
}

}  // namespace

// The shade of a pixel is a mean over those 2 pixels around, whose planes need a neighbour.
int OcclusionPass::neighbourhoodOf(const SceneFrame& frame) {
  constexpr int kMean = 2;
  if (!frame.ambient_occlusion) return 0;
  return kMean + std::max(1, static_cast<int>(std::ceil(reachIn(frame))) + 1);
}

OcclusionPass::OcclusionPass()
    : occlusion_program_(makeOcclusionProgram()),
      shade_program_(makeShadeProgram()),
      empty_array_(GlVertexArray::make()) {}

// Depth is that of one sample of a pixel; samples of the background stay as they are.
void OcclusionPass::draw(const GlTargets& targets, const SceneView& view) {
  if (width_ != targets.width() || height_ != targets.height()) {
    width_ = targets.width();
    height_ = targets.height();
    openness_ = makeTexture(GL_R8, width_, height_);
    openness_frame_ = GlFramebuffer::make();
    glNamedFramebufferTexture(*openness_frame_, GL_COLOR_ATTACHMENT0, *openness_, 0);
  }
  targets.resolve(GL_DEPTH_BUFFER_BIT);
  glBindTextureUnit(0, targets.resolvedDepth());
  glBindTextureUnit(1, *openness_);
  glBindVertexArray(*empty_array_);
  const auto cover = [&](const GlProgram& program) {
    setPlacesOfPixels(program, view);
    setUniform(program, "reach", reachIn(view.frame));
    glDrawArrays(GL_TRIANGLES, 0, 3);
  };
  glDisable(GL_DEPTH_TEST);
  glDisable(GL_BLEND);
  glBindFramebuffer(GL_FRAMEBUFFER, *openness_frame_);
  cover(occlusion_program_);
  glBindFramebuffer(GL_FRAMEBUFFER, targets.sampledFrame());
  glEnable(GL_DEPTH_TEST);
  glDepthMask(GL_FALSE);
  glDepthFunc(GL_LESS);  // passes everything that is not background
  glEnable(GL_BLEND);
  glBlendFuncSeparate(GL_ZERO, GL_SRC_COLOR, GL_ZERO, GL_ONE);
  cover(shade_program_);
  glDisable(GL_BLEND);
  glDepthFunc(GL_GREATER);
  glDepthMask(GL_TRUE);
}

}  // namespace isobrick
