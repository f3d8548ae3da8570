// Depths of a frame, for tests that wait for them.
#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <optional>

#include "isobrick/viewer/render/scene_renderer.h"

namespace isobrick::test {

// Of the surface under a pixel of the frame drawn last, as DepthReadback gives it.
inline std::optional<double> distanceAt(DepthReadback& readback, const glm::dvec2& pixel) {
  const std::uint64_t question = readback.askDistance(pixel);
  for (;;)
    if (const auto answer = readback.takeDistance()) {
      EXPECT_EQ(answer->question, question);
      return answer->distance;
    }
}

}  // namespace isobrick::test
