// Crossings within a batch against the tests' own search, on random triangles of few places, which
// touch, lie on each other and vanish.
#include "isobrick/extract/self_crossings.h"

#include <gtest/gtest.h>

#include <set>

#include "tests/support/crossing_triangles.h"
#include "tests/support/random_numbers.h"

namespace isobrick::test {
namespace {

TEST(SelfCrossings, AreThoseOfRandomTriangles) {
  SelfCrossings crossings;
  std::size_t found_some = 0, found_none = 0;
  for (unsigned seed = 0; seed < 3000; ++seed) {
    Random random(seed);
    // From a few places, where much is flat, to the whole range.
    const std::int64_t most = std::int64_t{1} << randomInt(random, 1, 25);
    const std::int64_t vertices = randomInt(random, 3, 12), count = randomInt(random, 1, 6);
    std::vector<glm::ivec3> positions;
    std::vector<glm::dvec3> same;
    for (std::int64_t v = 0; v < vertices; ++v) {
      const glm::dvec3 at(randomInt(random, -most, most), randomInt(random, -most, most),
                          randomInt(random, -most, most));
      positions.emplace_back(at);
      same.push_back(at);
    }
    std::vector<SelfCrossings::Triangle> triangles;
    std::vector<std::uint32_t> corners;
    while (triangles.size() < static_cast<std::size_t>(count)) {
      SelfCrossings::Triangle triangle;
      for (std::uint32_t& v : triangle)
        v = static_cast<std::uint32_t>(randomInt(random, 0, vertices - 1));
      if (std::set(triangle.begin(), triangle.end()).size() < 3) continue;
      triangles.push_back(triangle);
      corners.insert(corners.end(), triangle.begin(), triangle.end());
    }
    std::set<std::size_t> expected;
    for (const auto& [a, b] : crossingTriangles(same, corners)) expected.insert({a, b});
    const auto found = crossings.find(positions, triangles);
    EXPECT_EQ(std::set<std::size_t>(found.begin(), found.end()), expected) << "seed " << seed;
    ++(expected.empty() ? found_none : found_some);
  }
  EXPECT_GT(found_some, 500u);
  EXPECT_GT(found_none, 500u);
}

}  // namespace
}  // namespace isobrick::test
