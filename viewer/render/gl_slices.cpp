#include "isobrick/viewer/render/gl_slices.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <limits>
#include <string>

#include "isobrick/viewer/render/gl_targets.h"
#include "isobrick/viewer/render/scene_shaders.h"

namespace isobrick {

GlSlices::GlSlices(GlDevice& device)
    : device_(device), program_(makeSliceProgram(false)), empty_array_(GlVertexArray::make()) {}

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

void GlSlices::drawOpaque(const SceneView& view) const {
  glEnable(GL_DEPTH_TEST);
  glDisable(GL_BLEND);
  if (view.frame.normals) glColorMask(GL_FALSE, GL_FALSE, GL_FALSE, GL_FALSE);
  for (const SceneSlice& slice : view.frame.slices)
    if (slice.opacity >= 1.0) draw(program_, view, slice);
  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
}

BufferBox GlSlices::layerPixels(const SceneView& view) {
  BufferBox pixels;
  for (const SceneSlice& slice : view.frame.slices) {
    if (slice.opacity >= 1.0) continue;
    const glm::dvec3 end = slice.corner + slice.across;
    pixels.include(view.pixelsOf(
        std::array{slice.corner, end, slice.corner + slice.along, end + slice.along}));
  }
  return pixels;
}

void GlSlices::drawLayers(const SceneView& view, const LayerPass& layers) {
  if (*layers_program_ == 0) layers_program_ = makeSliceProgram(true);
  layers.use(layers_program_);
  for (const SceneSlice& slice : view.frame.slices)
    if (slice.opacity < 1.0) draw(layers_program_, view, slice);
}

void GlSlices::draw(const GlProgram& program, const SceneView& view,
                    const SceneSlice& slice) const {
  useProgram(program, view, slice.cap_of);
  setUniform(program, "corner", view.eyePosition(slice.corner));
  setUniform(program, "across", glm::vec3(view.to_eye * slice.across));
  setUniform(program, "along", glm::vec3(view.to_eye * slice.along));
  setUniform(program, "window", glm::vec2(glm::dvec2(slice.black, slice.white)));
  using Limits = std::numeric_limits<float>;
  const float least = slice.below_value ? Limits::infinity() : Limits::lowest();
  setUniform(program, "least_value",
             slice.least_value ? static_cast<float>(*slice.least_value) : least);
  setUniform(program, "below_value",
             slice.below_value ? static_cast<float>(*slice.below_value) : -Limits::infinity());
  setUniform(program, "opacity", static_cast<float>(slice.opacity));
  glBindTextureUnit(0, *slices_.at(slice.image).texture);
  glBindVertexArray(*empty_array_);
  glDrawArrays(GL_TRIANGLE_STRIP, 0, 4);
}

}  // namespace isobrick
