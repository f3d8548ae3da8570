#include "isobrick/viewer/session/drawn_scene.h"

#include <glm/common.hpp>

namespace isobrick {

bool DrawnScene::draw(SceneRenderer& renderer, const SceneFrame& frame, bool anew) {
  if (!anew && frame_ == frame) return false;
  forget();
  renderer.draw(frame);
  frame_ = frame;
  return true;
}

void DrawnScene::forget() { frame_.reset(); }

std::uint64_t DrawnScene::ask(DepthReadback& readback, const glm::dvec2& pixel) {
  if (!frame_) return 0;
  // A depth is that of the middle of a pixel, wherever in it the cursor is.
  const glm::dvec2 middle = glm::floor(pixel) + 0.5;
  const glm::dvec2 place = 2.0 * middle / glm::dvec2(frame_->width, frame_->height) - 1.0;
  asked_.push_back({readback.askDistance(pixel), frame_->camera, {place.x, -place.y}});
  return asked_.back().question;
}

std::optional<DrawnScene::Answer> DrawnScene::take(DepthReadback& readback) {
  while (!asked_.empty()) {
    const std::optional<DistanceAnswer> distance = readback.takeDistance();
    if (!distance) return std::nullopt;
    while (!asked_.empty() && asked_.front().question < distance->question) asked_.pop_front();
    // Others may have asked before.
    if (asked_.empty() || asked_.front().question != distance->question) continue;
    const Asked asked = asked_.front();
    asked_.pop_front();
    Answer answer{asked.question, std::nullopt};
    if (distance->distance)
      answer.point = rayThrough(asked.camera, asked.place).at(*distance->distance);
    return answer;
  }
  return std::nullopt;
}

}  // namespace isobrick
