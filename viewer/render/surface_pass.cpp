#include "isobrick/viewer/render/surface_pass.h"

#include <glm/vec2.hpp>
#include <string>
#include <vector>

#include "isobrick/viewer/render/scene_shaders.h"

namespace isobrick {

SurfacePass::SurfacePass(const GlDevice& device) : draws_(device.isSoftware()) {
  // The others follow when they are first needed.
  programOf({});
  if (device.limits().drawsEdges(0)) programOf({.wireframe = true});
}

void SurfacePass::begin(const GlChunks& chunks, const SceneView& view, const ShadowPass* shadow) {
  shadow_ = shadow;
  draws_.resetCounts();
  draws_.collect(chunks, view, view.planesDrawn());
}

void SurfacePass::use(const GlProgram& program, const SceneView& view) const {
  const SceneFrame& frame = view.frame;
  if (shadow_ != nullptr) glBindTextureUnit(3, shadow_->depths());
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
  setUniform(program, "by_component", static_cast<int>(frame.color_by_component));
  if (frame.color_by_component)
    for (std::size_t place = 0; place < kComponentColorCount; ++place) {
      const std::string name = "component_colors[" + std::to_string(place) + "]";
      setUniform(program, name.c_str(), linearColor(componentColor(place)));
    }
  setUniform(program, "by_plane", static_cast<int>(frame.value_plane.has_value()));
  if (frame.value_plane) setUniform(program, "value_plane", view.planeSeen(*frame.value_plane));
  setUniform(program, "key_direction", keyLightDirection());
  setUniform(program, "headlight", static_cast<int>(frame.headlight));
  setUniform(program, "back_color", linearColor(frame.back_color));
  if (shadow_ != nullptr) {
    setUniform(program, "shadow_rotation", shadow_->seen().rotation);
    setUniform(program, "shadow_offset", shadow_->seen().offset);
    setUniform(program, "shadow_projection", shadow_->seen().projection);
    setUniform(program, "shadow_texel", shadow_->seen().texel);
  }
  glEnable(GL_DEPTH_TEST);
  glDisable(GL_BLEND);
}

void SurfacePass::drawOpaque(const GlChunks& chunks, const SceneView& view) {
  const SceneFrame& frame = view.frame;
  if (frame.chunks.empty()) return;
  use(programOf({.wireframe = frame.wireframe, .in_shadow = shadow_ != nullptr}), view);
  for (std::size_t s = 0; s < frame.surfaces.size(); ++s)
    if (frame.isOpaque(s)) draws_.draw(chunks, static_cast<int>(s), frame.wireframe);
}

BufferBox SurfacePass::layerPixels(const SceneView& view) const {
  BufferBox pixels;
  for (std::size_t s = 0; s < view.frame.surfaces.size(); ++s)
    if (!view.frame.isOpaque(s)) pixels.include(draws_.pixelsOf(view, static_cast<int>(s)));
  return pixels;
}

GlProgram& SurfacePass::programOf(const SurfaceProgramKind& kind) {
  const unsigned place =
      (kind.wireframe ? 1u : 0u) + (kind.as_layers ? 2u : 0u) + (kind.in_shadow ? 4u : 0u);
  GlProgram& program = programs_[place];
  if (*program == 0) program = makeSurfaceProgram(kind);
  return program;
}

void SurfacePass::drawLayers(const GlChunks& chunks, const SceneView& view, const LayerPass& layers,
                             const BufferBox& band) {
  const SceneFrame& frame = view.frame;
  if (layers.isInBands()) draws_.collect(chunks, view, view.planesOfRows(band.bottom, band.top));
  const GlProgram& program =
      programOf({.wireframe = frame.wireframe, .as_layers = true, .in_shadow = shadow_ != nullptr});
  use(program, view);
  layers.use(program);
  for (std::size_t s = 0; s < frame.surfaces.size(); ++s)
    if (!frame.isOpaque(s)) draws_.draw(chunks, static_cast<int>(s), frame.wireframe);
}

}  // namespace isobrick
