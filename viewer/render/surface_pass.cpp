#include "isobrick/viewer/render/surface_pass.h"

#include <algorithm>
#include <glm/vec2.hpp>
#include <vector>

#include "isobrick/viewer/render/scene_shaders.h"

namespace isobrick {

SurfacePass::SurfacePass(const GlDevice& device)
    : program_(makeSurfaceProgram(false)), draws_(device.isSoftware()) {
  if (device.limits().drawsEdges(0)) wire_program_ = makeSurfaceProgram(true);
}

void SurfacePass::begin(const GlChunks& chunks, const SceneView& view, const ShadowPass* shadow) {
  shadow_ = shadow;
  draws_.resetCounts();
  draws_.collect(chunks, view, view.planesOfPicture());
}

void SurfacePass::use(const SceneView& view) const {
  const SceneFrame& frame = view.frame;
  const GlProgram& program = frame.wireframe ? wire_program_ : program_;
  useProgram(program, view);
  setUniform(program, "lattice_to_eye", glm::mat3(view.to_eye * frame.lattice.matrix));
  setUniform(program, "world_to_eye", glm::mat3(view.to_eye));
  setUniform(program, "eye_rest", glm::vec3(view.snapped.rest));
  setUniform(program, "as_normals", static_cast<int>(frame.normals));
  setUniform(program, "by_value", static_cast<int>(frame.value_window.has_value()));
  if (frame.value_window) {
    const auto [low, high] = *frame.value_window;
    setUniform(program, "value_window", glm::vec2(glm::dvec2(low, high)));
    setUniform(program, "value_colors", colorsOf(frame.color_map));
    setUniform(program, "value_opacity",
               glm::vec2(glm::dvec2(frame.value_opacity[0], frame.value_opacity[1])));
  }
  setUniform(program, "by_plane", static_cast<int>(frame.value_plane.has_value()));
  if (frame.value_plane) setUniform(program, "value_plane", view.planeSeen(*frame.value_plane));
  setUniform(program, "key_direction", keyLightDirection());
  setUniform(program, "headlight", static_cast<int>(frame.headlight));
  setUniform(program, "back_color", linearColor(frame.back_color));
  const bool shadow = shadow_ != nullptr;
  setUniform(program, "in_shadow", static_cast<int>(shadow));
  if (shadow) {
    setUniform(program, "shadow_rotation", shadow_->seen().rotation);
    setUniform(program, "shadow_offset", shadow_->seen().offset);
    setUniform(program, "shadow_projection", shadow_->seen().projection);
    setUniform(program, "shadow_texel", shadow_->seen().texel);
    glBindTextureUnit(3, shadow_->depths());
  }
  glEnable(GL_DEPTH_TEST);
  glDisable(GL_BLEND);
}

void SurfacePass::drawOpaque(const GlChunks& chunks, const SceneView& view) {
  const SceneFrame& frame = view.frame;
  if (frame.chunks.empty()) return;
  use(view);
  for (std::size_t s = 0; s < frame.surfaces.size(); ++s)
    if (frame.isOpaque(s)) draws_.draw(chunks, static_cast<int>(s), frame.wireframe);
}

// Only the nearest part of one is seen, so its depth goes first.
void SurfacePass::drawTranslucent(const GlChunks& chunks, const SceneView& view) {
  const SceneFrame& frame = view.frame;
  std::vector<int> translucent;
  for (std::size_t s = 0; s < frame.surfaces.size(); ++s)
    if (frame.surfaces[s].opacity > 0.0 && !frame.isOpaque(s))
      translucent.push_back(static_cast<int>(s));
  if (translucent.empty() || frame.chunks.empty()) return;
  use(view);
  std::stable_sort(translucent.begin(), translucent.end(), [&](int a, int b) {
    return frame.surfaces[static_cast<std::size_t>(a)].order <
           frame.surfaces[static_cast<std::size_t>(b)].order;
  });
  for (const int surface : translucent) {
    glColorMask(GL_FALSE, GL_FALSE, GL_FALSE, GL_FALSE);
    draws_.draw(chunks, surface, frame.wireframe);
    glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
    glDepthFunc(GL_EQUAL);
    if (!frame.normals) glEnable(GL_BLEND);
    glBlendFuncSeparate(GL_SRC_ALPHA, GL_ONE_MINUS_SRC_ALPHA, GL_ONE, GL_ONE_MINUS_SRC_ALPHA);
    draws_.draw(chunks, surface, frame.wireframe);
    glDisable(GL_BLEND);
    glDepthFunc(GL_GREATER);
  }
}

}  // namespace isobrick
