#include "isobrick/viewer/render/gl_scene_renderer.h"

#include <algorithm>
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

// Tiles begin at multiples of so many pixels of the picture: derivatives are taken in blocks of 2.
constexpr int kTileStep = 4;

// What is drawn for a tile: its pixels and those that count for them.
PixelBox drawnFor(const PixelBox& tile, int around, const SceneFrame& frame) {
  const auto downTo = [](int pixel) { return std::max(0, pixel) / kTileStep * kTileStep; };
  const int left = downTo(tile.left - around);
  const int right = std::min(frame.width, tile.right() + around);
  const int from_below = downTo(frame.height - tile.bottom() - around);
  const int top = std::max(0, tile.top - around);
  return {left, top, right - left, frame.height - from_below - top};
}

SceneFrame withoutEdges(SceneFrame frame) {
  frame.wireframe = false;
  return frame;
}

}  // namespace

GlSceneRenderer::GlSceneRenderer(Uploads uploads, const std::optional<GlLimits>& limits)
    : device_(limits),
      frame_(device_),
      chunks_(device_, uploads == Uploads::kStaged || !device_.isSoftware()),
      slices_(device_),
      surfaces_(device_),
      layers_(device_),
      background_program_(makeBackgroundProgram()),
      screen_program_(makeScreenProgram()),
      empty_array_(GlVertexArray::make()) {}

void GlSceneRenderer::draw(const SceneFrame& frame) {
  if (frame.wireframe && !drawsEdges()) return draw(withoutEdges(frame));
  const SceneView view(frame);
  depth_ = view.depth;
  transparent_ = frame.transparent;
  paint(view, frame_);
}

bool GlSceneRenderer::drawsEdges() const {
  return device_.limits().drawsEdges(chunks_.arenas().greatestBytes());
}

int GlSceneRenderer::neighbourhoodOf(const SceneFrame& frame) const {
  return frame.normals ? 0 : OcclusionPass::neighbourhoodOf(frame);
}

Image GlSceneRenderer::drawTile(const SceneFrame& frame, const PixelBox& tile, bool depth) {
  if (frame.wireframe && !drawsEdges()) return drawTile(withoutEdges(frame), tile, depth);
  assert(tile.width > 0 && tile.height > 0 && tile.left >= 0 && tile.top >= 0);
  assert(tile.right() <= frame.width && tile.bottom() <= frame.height);
  if (!tile_) tile_.emplace(device_);
  const SceneView view(frame, drawnFor(tile, neighbourhoodOf(frame), frame));
  paint(view, *tile_);
  const GlTargets& targets = tile_->targets;
  const PixelBox part{tile.left - view.drawn.left, tile.top - view.drawn.top, tile.width,
                      tile.height};
  Image image = targets.picture(part, frame.transparent);
  if (depth) image.depth = targets.distances(part, view.depth);
  return image;
}

void GlSceneRenderer::paint(const SceneView& view, Buffers& buffers) {
  const SceneFrame& frame = view.frame;
  assert(frame.width > 0 && frame.height > 0 && frame.clip_planes.size() <= 6);
  auto& [targets, shadow, occlusion] = buffers;
  targets.resize(view.drawn.width, view.drawn.height);
  device_.forgetErrors();
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
  if (with_shadow) shadow.draw(chunks_, view);
  const bool with_occlusion = frame.ambient_occlusion && !frame.normals;
  if (with_occlusion) occlusion.drawAround(chunks_, view);
  cutBy(0);
  surfaces_.begin(chunks_, view, with_shadow ? &shadow : nullptr);
  glBindFramebuffer(GL_FRAMEBUFFER, targets.sampledFrame());
  glClear(GL_DEPTH_BUFFER_BIT);
  drawBackground(view);
  cutBy(frame.clip_planes.size());
  surfaces_.drawOpaque(chunks_, view);
  if (with_occlusion) {
    cutBy(0);
    occlusion.draw(targets, view);
    cutBy(frame.clip_planes.size());
  }
  slices_.drawOpaque(view);
  cutBy(0);
  drawLayers(view, targets);
  if (!frame.normals) {
    lines_.drawSegments(view);
    lines_.drawSphere(view);
  }
  targets.resolve(GL_COLOR_BUFFER_BIT);
  // Code that draws next to it (a panel) does not expect these.
  glClipControl(GL_LOWER_LEFT, GL_NEGATIVE_ONE_TO_ONE);
  glDisable(GL_DEPTH_TEST);
  glBindVertexArray(0);
  glUseProgram(0);
  try {
    device_.checkErrors("cannot render: " + device_.name() +
                        " has no memory left; choose a smaller width or height");
  } catch (...) {
    shadow.forget();
    throw;
  }
}

// Of normals, those of the nearest surface that is not clear.
void GlSceneRenderer::drawLayers(const SceneView& view, const GlTargets& targets) {
  const BufferBox of_surfaces = surfaces_.layerPixels(view);
  const BufferBox of_slices = view.frame.normals ? BufferBox{} : GlSlices::layerPixels(view);
  BufferBox pixels = of_surfaces;
  pixels.include(of_slices);
  if (pixels.isEmpty()) return layers_.release();
  layers_.draw(targets, pixels, [&](const BufferBox& band) {
    cutBy(view.frame.clip_planes.size());
    if (!of_surfaces.isEmpty()) surfaces_.drawLayers(chunks_, view, layers_, band);
    if (!of_slices.isEmpty()) slices_.drawLayers(view, layers_);
    cutBy(0);
  });
}

void GlSceneRenderer::drawBackground(const SceneView& view) {
  const SceneFrame& frame = view.frame;
  glDisable(GL_DEPTH_TEST);
  glDisable(GL_BLEND);
  if (frame.transparent || frame.normals) {
    glClearColor(0.0f, 0.0f, 0.0f, 0.0f);
    return glClear(GL_COLOR_BUFFER_BIT);
  }
  glUseProgram(*background_program_);
  setUniform(background_program_, "top", linearColor(frame.background_top));
  setUniform(background_program_, "bottom", linearColor(frame.background_bottom));
  setUniform(background_program_, "first_row", static_cast<float>(view.firstPixel().y));
  setUniform(background_program_, "picture_height", static_cast<float>(frame.height));
  glViewport(0, 0, view.drawn.width, view.drawn.height);
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
  glViewport(left, bottom, frame_.targets.width(), frame_.targets.height());
  glDisable(GL_DEPTH_TEST);
  glDisable(GL_BLEND);
  glDisable(GL_SCISSOR_TEST);
  glUseProgram(*screen_program_);
  setUniform(screen_program_, "corner", glm::vec2(left, bottom));
  glBindTextureUnit(0, frame_.targets.resolvedColor());
  glBindVertexArray(*empty_array_);
  glDrawArrays(GL_TRIANGLES, 0, 3);
  glBindVertexArray(0);
}

}  // namespace isobrick
