#include "isobrick/viewer/render/depth_pass.h"

#include "isobrick/viewer/render/gl_targets.h"
#include "isobrick/viewer/render/scene_shaders.h"

namespace isobrick {

DepthPass::DepthPass(bool is_software) : program_(makeDepthProgram()), draws_(is_software) {}

void DepthPass::resize(int width, int height) {
  if (width == width_ && height == height_) return;
  depths_ = makeTexture(GL_DEPTH_COMPONENT32F, width, height);
  frame_ = GlFramebuffer::make();
  glNamedFramebufferTexture(*frame_, GL_DEPTH_ATTACHMENT, *depths_, 0);
  glNamedFramebufferDrawBuffer(*frame_, GL_NONE);
  width_ = width;
  height_ = height;
}

void DepthPass::draw(const GlChunks& chunks, const SceneView& view) {
  const SceneFrame& frame = view.frame;
  resize(view.drawn.width, view.drawn.height);
  glBindFramebuffer(GL_FRAMEBUFFER, *frame_);
  glClear(GL_DEPTH_BUFFER_BIT);
  glEnable(GL_DEPTH_TEST);
  glDisable(GL_BLEND);
  useProgram(program_, view);
  setUniform(program_, "lattice_to_eye", glm::mat3(view.to_eye * frame.lattice.matrix));
  setUniform(program_, "world_to_eye", glm::mat3(view.to_eye));
  setUniform(program_, "eye_rest", glm::vec3(view.snapped.rest));
  draws_.collect(chunks, view, view.planesDrawn());
  for (std::size_t s = 0; s < frame.surfaces.size(); ++s)
    if (frame.isOpaque(s)) draws_.draw(chunks, static_cast<int>(s), false);
}

}  // namespace isobrick
