// The shadow of opaque surfaces in the key light, which stands beside the camera.
#pragma once

#include <glm/mat3x3.hpp>
#include <glm/vec3.hpp>
#include <glm/vec4.hpp>
#include <optional>

#include "isobrick/viewer/render/depth_pass.h"
#include "isobrick/viewer/render/gl_chunks.h"
#include "isobrick/viewer/render/gl_device.h"
#include "isobrick/viewer/render/scene_view.h"

namespace isobrick {

// From the eye's coordinates to those of the light, and to its picture of depths.
struct ShadowView {
  glm::mat3 rotation{1.0f};
  glm::vec3 offset{0.0f};
  glm::vec4 projection{1.0f};  // as SceneView::projection, of parallel rays
  float texel = 0.0f;          // of the picture, world units
};

// Depths seen from the light (Williams 1978): a point behind them lies in the shadow. Its edge is
// soft, as 25 neighbours are asked (Reeves et al. 1987).
class ShadowPass {
 public:
  // Throws Error if the driver refuses the shader.
  explicit ShadowPass(const GlDevice& device);

  // Draws the depths of the frame's opaque surfaces, unless they are still those of this very
  // frame: all tiles of a picture have the same. Binds another frame buffer.
  void draw(const GlChunks& chunks, const SceneView& view);
  // The memory of these depths may be lacking.
  void forget() { drawn_.reset(); }
  // Of the last draw().
  const ShadowView& seen() const { return seen_; }
  // With filters that compare.
  GLuint depths() const { return depths_.depths(); }

 private:
  const GlDevice& device_;
  DepthPass depths_;
  ShadowView seen_;
  std::optional<SceneFrame> drawn_;
};

}  // namespace isobrick
