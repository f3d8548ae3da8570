#include "isobrick/viewer/session/drawn_scene.h"

#include <glm/geometric.hpp>
#include <utility>

namespace isobrick {

bool DrawnScene::draw(SceneRenderer& renderer, const SceneFrame& frame, bool anew) {
  if (!anew && frame_ == frame) return false;
  forget();
  renderer.draw(frame);
  frame_ = frame;
  return true;
}

Image DrawnScene::picture(SceneRenderer& renderer, SceneFrame frame, bool layers) {
  forget();
  renderer.draw(frame);
  Image image = renderer.picture();
  if (!layers) return image;
  frame.normals = true;
  frame.transparent = false;
  renderer.draw(frame);
  image.normals = renderer.picture().rgb;
  // Samples of a pixel were averaged.
  for (std::size_t i = 0; i + 2 < image.normals.size(); i += 3) {
    glm::vec3 normal(image.normals[i], image.normals[i + 1], image.normals[i + 2]);
    const float length = glm::length(normal);
    for (glm::length_t c = 0; c < 3; ++c)
      image.normals[i + static_cast<std::size_t>(c)] = length > 1e-3f ? normal[c] / length : 0.0f;
  }
  image.depth = renderer.distances();
  return image;
}

void DrawnScene::forget() {
  frame_.reset();
  hit_.reset();
}

std::optional<glm::dvec3> DrawnScene::surfaceAt(SceneReadback& readback,
                                                const glm::dvec2& pixel) const {
  if (!frame_) return std::nullopt;
  const std::optional<double> distance = readback.distanceAt(pixel);
  if (!distance) return std::nullopt;
  const glm::dvec2 place = 2.0 * (pixel + 0.5) / glm::dvec2(frame_->width, frame_->height) - 1.0;
  return rayThrough(frame_->camera, {place.x, -place.y}).at(*distance);
}

std::optional<glm::dvec3> DrawnScene::surfaceUnder(SceneReadback& readback,
                                                   const glm::dvec2& cursor) {
  if (!hit_ || hit_->cursor != cursor) hit_ = Hit{cursor, surfaceAt(readback, cursor)};
  return hit_->point;
}

}  // namespace isobrick
