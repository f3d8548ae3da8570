// The scene as a renderer drew it last.
#pragma once

#include <cstdint>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <optional>

#include "isobrick/viewer/render/scene_renderer.h"

namespace isobrick {

// A frame that is the one drawn last is not drawn again: chunks and slices with the same numbers
// have the same contents, and the renderer still has its picture. Used by the renderer's thread;
// nobody else draws with it meanwhile, or forget() comes first.
class DrawnScene {
 public:
  // True if it was drawn; `anew`: in any case. Throws as SceneRenderer::draw().
  bool draw(SceneRenderer& renderer, const SceneFrame& frame, bool anew);
  // The renderer's picture is none of these any longer.
  void forget();

  // The surface under a pixel (from the top left) of the frame drawn last; none if there is
  // background, or no frame. The depths are those of the camera that drew them, and not of one that
  // has moved since.
  std::optional<glm::dvec3> surfaceAt(SceneReadback& readback, const glm::dvec2& pixel) const;
  // The same, read back once for a place and a frame that stay the same.
  std::optional<glm::dvec3> surfaceUnder(SceneReadback& readback, const glm::dvec2& cursor);

 private:
  struct Hit {
    glm::dvec2 cursor{0.0};
    std::optional<glm::dvec3> point;
  };
  std::optional<SceneFrame> frame_;  // none: none was drawn
  std::optional<Hit> hit_;           // of that frame
};

}  // namespace isobrick
