#include "isobrick/viewer/render/gl_slices.h"

#include <algorithm>
#include <cassert>
#include <glm/geometric.hpp>
#include <limits>
#include <string>
#include <vector>

#include "isobrick/viewer/render/gl_targets.h"
#include "isobrick/viewer/render/scene_shaders.h"

namespace isobrick {

GlSlices::GlSlices(GlDevice& device)
    : device_(device), program_(makeSliceProgram()), empty_array_(GlVertexArray::make()) {}

SliceId GlSlices::reserve(int width, int height) {
  Slice kept;
  device_.forgetErrors();
  kept.bytes =
      sizeof(float) * static_cast<std::uint64_t>(width) * static_cast<std::uint64_t>(height);
  kept.texture = makeTexture(GL_R32F, width, height);
  glTextureParameteri(*kept.texture, GL_TEXTURE_MIN_FILTER, GL_LINEAR);
  glTextureParameteri(*kept.texture, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
  glTextureParameteri(*kept.texture, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
  glTextureParameteri(*kept.texture, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
  device_.checkErrors("cannot keep a slice of " + std::to_string(width) + " x " +
                      std::to_string(height) + " values: " + device_.name() +
                      " has no memory left; show fewer slices");
  bytes_kept_ += kept.bytes;
  slices_.emplace(++last_, std::move(kept));
  return last_;
}

void GlSlices::uploadRows(SliceId slice, const SliceImage& image, int first, int count) {
  glPixelStorei(GL_UNPACK_ALIGNMENT, 4);
  glTextureSubImage2D(*slices_.at(slice).texture, 0, 0, first, image.width, count, GL_RED, GL_FLOAT,
                      image.values.data() +
                          static_cast<std::size_t>(first) * static_cast<std::size_t>(image.width));
}

void GlSlices::release(SliceId slice) {
  const auto found = slices_.find(slice);
  assert(found != slices_.end());
  bytes_kept_ -= found->second.bytes;
  slices_.erase(found);
}

void GlSlices::draw(const SceneView& view, bool translucent) const {
  std::vector<SceneSlice> slices;
  for (const SceneSlice& slice : view.frame.slices)
    if ((slice.opacity < 1.0) == translucent) slices.push_back(slice);
  const auto away = [&](const SceneSlice& slice) {
    const glm::dvec3 middle = slice.corner + 0.5 * (slice.across + slice.along);
    return glm::dot(middle - view.frame.camera.eye, view.frame.camera.forward);
  };
  std::stable_sort(slices.begin(), slices.end(),
                   [&](const SceneSlice& a, const SceneSlice& b) { return away(a) > away(b); });
  glEnable(GL_DEPTH_TEST);
  if (view.frame.normals) glColorMask(GL_FALSE, GL_FALSE, GL_FALSE, GL_FALSE);
  glBlendFuncSeparate(GL_SRC_ALPHA, GL_ONE_MINUS_SRC_ALPHA, GL_ONE, GL_ONE_MINUS_SRC_ALPHA);
  glBindVertexArray(*empty_array_);
  (translucent ? glEnable : glDisable)(GL_BLEND);
  glDepthMask(translucent ? GL_FALSE : GL_TRUE);
  for (const SceneSlice& slice : slices) {
    useProgram(program_, view, slice.cap_of);
    setUniform(program_, "corner", view.eyePosition(slice.corner));
    setUniform(program_, "across", glm::vec3(view.to_eye * slice.across));
    setUniform(program_, "along", glm::vec3(view.to_eye * slice.along));
    setUniform(program_, "window", glm::vec2(glm::dvec2(slice.black, slice.white)));
    setUniform(program_, "least_value",
               slice.least_value ? static_cast<float>(*slice.least_value)
                                 : std::numeric_limits<float>::lowest());
    setUniform(program_, "opacity", static_cast<float>(translucent ? slice.opacity : 1.0));
    glBindTextureUnit(0, *slices_.at(slice.image).texture);
    glDrawArrays(GL_TRIANGLE_STRIP, 0, 4);
  }
  glDisable(GL_BLEND);
  glDepthMask(GL_TRUE);
  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
}

}  // namespace isobrick
