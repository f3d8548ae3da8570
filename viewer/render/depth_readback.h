// Depths of a drawn frame, read back without waiting for the card.
#pragma once

#include <cstdint>
#include <glm/vec2.hpp>
#include <optional>

namespace isobrick {

// The distance along the camera's forward axis of the surface under a pixel; none if there is only
// background.
struct DistanceAnswer {
  std::uint64_t question = 0;
  std::optional<double> distance;
};

// Asked of one frame, answered by the time of a later one: a call that waited would stop the
// interface until the card has drawn. Used by the thread of the renderer.
class DepthReadback {
 public:
  virtual ~DepthReadback() = default;

  // For a pixel (from the top left) of the frame drawn last; returns the question's number. What is
  // drawn later does not change the answer.
  virtual std::uint64_t askDistance(const glm::dvec2& pixel) = 0;
  // The answers that have come, one a call, in the order of the questions; nothing: not yet.
  virtual std::optional<DistanceAnswer> takeDistance() = 0;
};

}  // namespace isobrick
