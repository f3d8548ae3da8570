// Chunks: as exact far from the world's origin as near it.
#include "isobrick/viewer/stream/surface_chunk.h"

#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <random>

namespace isobrick {
namespace {

// A vertex on the side of two bricks, with the bits that the extractor gives it in each; and eyes
// anywhere, in a volume of 2^20 voxels.
TEST(SurfaceChunkTest, NeighboursGiveASharedVertexTheSameBits) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> number(0.0, 1.0);
  int rounded = 0;
  for (int i = 0; i < 20000; ++i) {
    const double size = std::ldexp(1.0, static_cast<int>(random() % 14) + 7);
    const glm::dvec3 brick =
        glm::floor(glm::dvec3(number(random), number(random), number(random)) * size / 64.0) * 64.0;
    const glm::dvec3 next = brick + glm::dvec3(64.0, 0.0, 0.0);
    // Crossings lie on multiples of 2^-17 of an edge here, at the side of both bricks.
    const glm::dvec3 inside(64.0, std::floor(number(random) * 64.0), 64.0 * number(random));
    const glm::vec3 here(inside);
    const glm::vec3 there(here.x - 64.0f, here.y, here.z);
    const glm::dvec3 eye = size * glm::dvec3(number(random), 3.0 * number(random) - 1.0, 0.5);
    const SnappedEye snapped = snapEye(eye, 4.0 * size);
    EXPECT_EQ(snapped.snapped + snapped.rest, eye);
    const glm::vec3 a = here + snapped.offsetOf(brick), b = there + snapped.offsetOf(next);
    ASSERT_EQ(a, b) << size;
    // What one rounding to float leaves, of the distance from the eye.
    const glm::dvec3 exact = brick + glm::dvec3(here) - snapped.snapped;
    EXPECT_LE(glm::distance(glm::dvec3(a), exact), 1.1e-7 * (1.0 + glm::length(exact)));
    if (glm::vec3(brick - eye) + here != glm::vec3(next - eye) + there) ++rounded;
  }
  EXPECT_GT(rounded, 1000);  // without the snapping they differ
}

}  // namespace
}  // namespace isobrick
