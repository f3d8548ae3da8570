#include "isobrick/viewer/render/gl_scene_renderer.h"

#include <cassert>
#include <glm/vec2.hpp>

#include "isobrick/viewer/render/scene_shaders.h"
#include "isobrick/viewer/render/scene_view.h"

namespace isobrick {
namespace {

// Programs that know no clip planes are drawn with 0 of them.
void cutBy(std::size_t planes) {
  for (GLenum i = 0; i < 6; ++i) (i < planes ? glEnable : glDisable)(GL_CLIP_DISTANCE0 + i);
}

}  // namespace

GlSceneRenderer::GlSceneRenderer(Uploads uploads, const std::optional<GlLimits>& limits)
    : device_(limits),
      targets_(device_),
      chunks_(device_, uploads == Uploads::kStaged || !device_.isSoftware()),
      slices_(device_),
      surfaces_(device_),
      shadow_(device_),
      layers_(device_),
      background_program_(makeBackgroundProgram()),
      screen_program_(makeScreenProgram()),
      empty_array_(GlVertexArray::make()) {}

void GlSceneRenderer::draw(const SceneFrame& frame) {
  if (frame.wireframe && !device_.limits().drawsEdges(chunks_.arenas().greatestBytes())) {
    SceneFrame without_edges = frame;
    without_edges.wireframe = false;
    return draw(without_edges);
  }
  assert(frame.width > 0 && frame.height > 0 && frame.clip_planes.size() <= 6);
  targets_.resize(frame.width, frame.height);
  device_.forgetErrors();
  const SceneView view(frame);
  depth_ = view.depth;
  transparent_ = frame.transparent;
  glDisable(GL_SCISSOR_TEST);
  glDisable(GL_CULL_FACE);
  glDisable(GL_FRAMEBUFFER_SRGB);
  glClipControl(GL_LOWER_LEFT, GL_ZERO_TO_ONE);
  glDepthMask(GL_TRUE);
  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
  glClearDepth(0.0);
  glDepthFunc(GL_GREATER);
  cutBy(frame.clip_planes.size());
  const bool with_shadow = frame.shadow && !frame.headlight && !frame.normals;
  if (with_shadow) shadow_.draw(chunks_, view);
  cutBy(0);
  surfaces_.begin(chunks_, view, with_shadow ? &shadow_ : nullptr);
  glBindFramebuffer(GL_FRAMEBUFFER, targets_.sampledFrame());
  glViewport(0, 0, frame.width, frame.height);
  glClear(GL_DEPTH_BUFFER_BIT);
  drawBackground(frame);
  cutBy(frame.clip_planes.size());
  surfaces_.drawOpaque(chunks_, view);
  if (frame.ambient_occlusion && !frame.normals) {
    cutBy(0);
    occlusion_.draw(targets_, view);
    cutBy(frame.clip_planes.size());
  }
  if (frame.outlines && !frame.normals) {
    cutBy(0);
    outlines_.draw(targets_, view);
    cutBy(frame.clip_planes.size());
  }
  slices_.drawOpaque(view);
  cutBy(0);
  drawLayers(view);
  if (!frame.normals) {
    lines_.drawSegments(view);
    lines_.drawSphere(view);
  }
  targets_.resolve(GL_COLOR_BUFFER_BIT);
  // Code that draws next to it (a panel) does not expect these.
  glClipControl(GL_LOWER_LEFT, GL_NEGATIVE_ONE_TO_ONE);
  glDisable(GL_DEPTH_TEST);
  glBindVertexArray(0);
  device_.checkErrors("cannot render: " + device_.name() +
                      " has no memory left; choose a smaller width or height");
}

// Of normals, those of the nearest surface that is not clear.
void GlSceneRenderer::drawLayers(const SceneView& view) {
  const PixelBox of_surfaces = surfaces_.layerPixels(view);
  const PixelBox of_slices = view.frame.normals ? PixelBox{} : GlSlices::layerPixels(view);
  PixelBox pixels = of_surfaces;
  pixels.include(of_slices);
  if (pixels.isEmpty()) return layers_.release();
  layers_.draw(targets_, pixels, [&](const PixelBox& band) {
    cutBy(view.frame.clip_planes.size());
    if (!of_surfaces.isEmpty()) surfaces_.drawLayers(chunks_, view, layers_, band);
    if (!of_slices.isEmpty()) slices_.drawLayers(view, layers_);
    cutBy(0);
  });
}

void GlSceneRenderer::drawBackground(const SceneFrame& frame) {
  glDisable(GL_DEPTH_TEST);
  glDisable(GL_BLEND);
  if (frame.transparent || frame.normals) {
    glClearColor(0.0f, 0.0f, 0.0f, 0.0f);
    return glClear(GL_COLOR_BUFFER_BIT);
  }
  glUseProgram(*background_program_);
  setUniform(background_program_, "top", linearColor(frame.background_top));
  setUniform(background_program_, "bottom", linearColor(frame.background_bottom));
  glBindVertexArray(*empty_array_);
  glDrawArrays(GL_TRIANGLES, 0, 3);
}

void GlSceneRenderer::presentNothing(GLuint framebuffer, int width, int height) {
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
  glViewport(0, 0, width, height);
  glDisable(GL_SCISSOR_TEST);
  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
  glClearColor(0.16f, 0.17f, 0.19f, 1.0f);
  glClear(GL_COLOR_BUFFER_BIT);
}

void GlSceneRenderer::present(GLuint framebuffer, int left, int bottom) {
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
  glViewport(left, bottom, targets_.width(), targets_.height());
  glDisable(GL_DEPTH_TEST);
  glDisable(GL_BLEND);
  glDisable(GL_SCISSOR_TEST);
  glUseProgram(*screen_program_);
  setUniform(screen_program_, "corner", glm::vec2(left, bottom));
  glBindTextureUnit(0, targets_.resolvedColor());
  glBindVertexArray(*empty_array_);
  glDrawArrays(GL_TRIANGLES, 0, 3);
  glBindVertexArray(0);
}

}  // namespace isobrick
