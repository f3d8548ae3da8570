// Chunks in another lattice: where they were in the world, and closed as they were.
#include "isobrick/viewer/stream/moved_chunk.h"

#include <gtest/gtest.h>

#include <glm/geometric.hpp>
#include <random>

namespace isobrick {
namespace {

// A volume that is finer, turned and elsewhere: vertices stay where they are in the world, and
// those that two bricks share stay the same to the bit.
TEST(MovedChunkTest, AnotherLatticeKeepsPlacesAndSharedVertices) {
  std::mt19937 random(6);
  std::uniform_real_distribution<double> number(0.0, 1.0);
  const SceneLattice scene{glm::dmat3(0.8), {-3.0, 10.0, 7.0}};
  const SceneLattice own{0.3 * glm::dmat3(0.6, 0.8, 0.0, -0.8, 0.6, 0.0, 0.0, 0.0, 1.0),
                         {100.0, -20.0, 0.5}};
  for (int i = 0; i < 5000; ++i) {
    SurfaceChunk here, there;
    here.origin = glm::floor(1e4 * glm::dvec3(number(random), number(random), number(random)));
    there.origin = here.origin + glm::dvec3(64.0, 0.0, 0.0);
    const glm::vec3 shared(64.0f, 64.0f * static_cast<float>(number(random)), 17.0f);
    here.vertices.push_back({shared, {}, 0});
    there.vertices.push_back({shared - glm::vec3(64.0f, 0.0f, 0.0f), {}, 0});
    const glm::dvec3 before = own.toWorld(here.origin + glm::dvec3(shared));
    moveChunk(here, own, scene);
    moveChunk(there, own, scene);
    const auto placed = [](const SurfaceChunk& chunk) {
      return chunk.origin + glm::dvec3(chunk.vertices[0].position);
    };
    ASSERT_EQ(placed(here), placed(there));
    EXPECT_EQ(here.origin, glm::round(here.origin));
    EXPECT_EQ(here.lower, here.vertices[0].position);
    EXPECT_LE(glm::distance(scene.toWorld(placed(here)), before), 0.8 / 1024.0);
  }
}

}  // namespace
}  // namespace isobrick
