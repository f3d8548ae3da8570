#include "isobrick/viewer/render/shade_pass.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>

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

namespace {

constexpr int kMostPixels = 4096;  // of the picture of depths, to a side

// Parallel rays along the key light, with all that is drawn between them.
PlacedCamera lightCamera(const SceneView& view) {
  const glm::dmat3 to_world = glm::transpose(view.to_eye);
  const glm::dvec3 to_light = to_world * glm::dvec3(keyLightDirection());
  PlacedCamera camera;
  camera.orthographic = true;
  camera.forward = -to_light;
  camera.right = glm::normalize(glm::cross(camera.forward, view.frame.camera.up));
  camera.up = glm::cross(camera.right, camera.forward);
  const WorldBox& bounds = view.frame.bounds;
  const glm::dvec3 middle = 0.5 * (bounds.lower + bounds.upper);
  const double radius = 0.5 * glm::distance(bounds.lower, bounds.upper);
  camera.eye = middle + 2.0 * radius * to_light;
  camera.half_width = camera.half_height = radius;
  return camera;
}

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

ShadowPass::ShadowPass(const GlDevice& device) : device_(device), depths_(device.isSoftware()) {}

void ShadowPass::draw(const GlChunks& chunks, const SceneView& view) {
  const SceneFrame& frame = view.frame;
  if (drawn_ == frame) return;
  drawn_.reset();
  // As fine as the picture itself.
  const int size = device_.limits().shadowSize(
      std::clamp(2 * std::max(frame.width, frame.height), 512, kMostPixels));
  SceneFrame lit = frame;
  lit.camera = lightCamera(view);
  lit.width = lit.height = size;
  lit.wireframe = false;
  const SceneView light(lit);
  seen_.rotation = glm::mat3(light.to_eye * glm::transpose(view.to_eye));
  seen_.offset = glm::vec3(light.to_eye * (frame.camera.eye - lit.camera.eye));
  seen_.projection = light.projection;
  seen_.texel = static_cast<float>(2.0 * lit.camera.half_width / size);
  depths_.draw(chunks, light);
  const GLuint depths = depths_.depths();
  glTextureParameteri(depths, GL_TEXTURE_COMPARE_MODE, GL_COMPARE_REF_TO_TEXTURE);
  glTextureParameteri(depths, GL_TEXTURE_COMPARE_FUNC, GL_GEQUAL);  // 1 is near
  for (const GLenum filter : {GL_TEXTURE_MIN_FILTER, GL_TEXTURE_MAG_FILTER})
    glTextureParameteri(depths, filter, GL_LINEAR);
  for (const GLenum side : {GL_TEXTURE_WRAP_S, GL_TEXTURE_WRAP_T})
    glTextureParameteri(depths, side, GL_CLAMP_TO_EDGE);
  drawn_ = frame;
}

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
