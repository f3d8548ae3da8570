#include "isobrick/viewer/render/occlusion_pass.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "isobrick/viewer/render/scene_shaders.h"

namespace isobrick {
namespace {

constexpr float kOcclusionReach = 1.0f / 16;  // of the picture's height

float reachIn(const SceneFrame& frame) {
  return kOcclusionReach * static_cast<float>(frame.height);
}

// How many pixels of the picture one of the coarser depths is; 1: there are none.
int stepIn(const SceneFrame& frame) {
  constexpr float kReach = 64.0f;  // in coarser pixels, at least
  return std::max(1, static_cast<int>(reachIn(frame) / kReach));
}

// The coarse pixels that the pixels [first, end) and those within their reach lie in.
std::array<int, 2> coarseRange(int first, int end, double reach, int size, int coarse_size) {
  const double scale = static_cast<double>(coarse_size) / size;
  const int begin = static_cast<int>(std::floor((first - reach - 1.0) * scale)) - 1;
  const int last = static_cast<int>(std::ceil((end + reach + 1.0) * scale)) + 1;
  return {std::max(0, begin), std::min(coarse_size, last)};
}

}  // namespace

// The shade of a pixel is a mean over those 2 pixels around, whose planes need a neighbour.
int OcclusionPass::neighbourhoodOf(const SceneFrame& frame) {
  constexpr int kMean = 2, kPlane = 1;
  if (!frame.ambient_occlusion) return 0;
  if (stepIn(frame) > 1) return kMean + kPlane;
  return kMean + std::max(kPlane, static_cast<int>(std::ceil(reachIn(frame))) + 1);
}

void OcclusionPass::drawAround(const GlChunks& chunks, const SceneView& view) {
  const SceneFrame& frame = view.frame;
  const int step = stepIn(frame);
  if (step == 1) return;
  coarse_ = frame;
  coarse_.wireframe = false;
  coarse_.width = std::max(1, frame.width / step);
  coarse_.height = std::max(1, frame.height / step);
  const auto [left, right] =
      coarseRange(view.drawn.left, view.drawn.right(), reachIn(frame), frame.width, coarse_.width);
  const auto [top, bottom] = coarseRange(view.drawn.top, view.drawn.bottom(), reachIn(frame),
                                         frame.height, coarse_.height);
  around_drawn_ = {left, top, right - left, bottom - top};
  around_.draw(chunks, SceneView(coarse_, around_drawn_));
}

OcclusionPass::OcclusionPass(bool is_software)
    : occlusion_program_(makeOcclusionProgram()),
      shade_program_(makeShadeProgram()),
      around_(is_software),
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
  const bool has_coarse = stepIn(view.frame) > 1;
  if (has_coarse) glBindTextureUnit(2, around_.depths());
  const auto cover = [&](const GlProgram& program) {
    setPlacesOfPixels(program, view);
    setUniform(program, "reach", reachIn(view.frame));
    setUniform(program, "has_coarse", static_cast<int>(has_coarse));
    if (has_coarse) {
      const SceneView coarse(coarse_, around_drawn_);
      setUniform(program, "first_coarse", coarse.firstPixel());
      setUniform(program, "coarse_size", glm::vec2(coarse_.width, coarse_.height));
    }
    glDrawArrays(GL_TRIANGLES, 0, 3);
  };
  glDisable(GL_DEPTH_TEST);
  glDisable(GL_BLEND);
  glBindFramebuffer(GL_FRAMEBUFFER, *openness_frame_);
  cover(occlusion_program_);
  targets.multiply([&] { cover(shade_program_); });
}

}  // namespace isobrick
