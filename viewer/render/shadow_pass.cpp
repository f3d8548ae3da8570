#include "isobrick/viewer/render/shadow_pass.h"

#include <algorithm>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>

#include "isobrick/viewer/render/scene_shaders.h"

namespace isobrick {
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

}  // namespace isobrick
