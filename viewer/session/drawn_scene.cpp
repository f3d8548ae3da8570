#include "isobrick/viewer/session/drawn_scene.h"

namespace isobrick {

bool DrawnScene::draw(SceneRenderer& renderer, const SceneFrame& frame, bool anew) {
  if (!anew && frame_ == frame) return false;
  forget();
  renderer.draw(frame);
  frame_ = frame;
  return true;
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
