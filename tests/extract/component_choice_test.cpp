// A choice among the components of a surface, for other queries of the volume than that it was made
// for.
#include "isobrick/extract/sinks/component_choice.h"

#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <numbers>
#include <random>

#include "isobrick/extract/sinks/indexed_mesh.h"
#include "isobrick/extract/sinks/nearest_parts.h"
#include "tests/support/field_pyramid.h"
#include "tests/support/mesh_checker.h"
#include "tests/support/mesh_components.h"

namespace isobrick::test {
namespace {

// Three balls whose radii are 20, 12 and 6 at isovalue 0; bricks cut all of them.
class ComponentChoiceTest : public ::testing::Test {
 protected:
  ComponentChoiceTest() {
    BuildOptions build;
    build.brick_cells = 16;
    geometry_.spacing = {0.5, 0.5, 0.5};
    geometry_.origin = {1000, -2000, 500};
    pyramid_.emplace(buildField(
        folder_, Index3(97),
        [](const glm::dvec3& p) {
          return std::max({20 - glm::distance(p, kCenters[0]), 12 - glm::distance(p, kCenters[1]),
                           6 - glm::distance(p, kCenters[2])});
        },
        build, geometry_));
  }

  // A point of the ball's surface.
  ComponentSeed seed(int ball, double isovalue = 0) const {
    const double voxels = kRadii[ball] - isovalue, radius = 0.5 * voxels;
    const glm::dvec3 at = kCenters[ball] + voxels * glm::normalize(glm::dvec3(1, 2, -2));
    return {geometry_.indexToWorld(at), 4 * std::numbers::pi * radius * radius};
  }
  // The balls that the choice leaves of the query's surface, and the lost seeds.
  std::vector<int> ballsOf(const Query& query, const PieceChoice& choice, std::size_t lost) {
    Extractor extractor(*pyramid_);
    IndexedMeshSink sink;
    EXPECT_EQ(extractChosen(extractor, query, choice, sink).lost, lost);
    const IndexedMesh mesh = sink.takeMesh();
    const MeshReport report = checkMesh(mesh.positions, mesh.triangles, {});
    EXPECT_TRUE(report.ok()) << report.summary();
    std::array<bool, 3> seen{};
    for (const glm::dvec3& position : mesh.positions) {
      const glm::dvec3 index = geometry_.worldToIndex(position);
      int nearest = 0;
      for (int ball = 1; ball < 3; ++ball)
        if (glm::distance(index, kCenters[ball]) - kRadii[ball] <
            glm::distance(index, kCenters[nearest]) - kRadii[nearest])
          nearest = ball;
      seen[static_cast<std::size_t>(nearest)] = true;
    }
    std::vector<int> balls;
    for (int ball = 0; ball < 3; ++ball)
      if (seen[static_cast<std::size_t>(ball)]) balls.push_back(ball);
    return balls;
  }

  using Balls = std::vector<int>;
  static constexpr glm::dvec3 kCenters[3] = {{30, 30, 30}, {70, 70, 70}, {20, 75, 20}};
  static constexpr double kRadii[3] = {20, 12, 6};
  const TemporaryFolder folder_;
  GridGeometry geometry_;
  std::optional<Pyramid> pyramid_;
};

TEST_F(ComponentChoiceTest, KeepsHidesAndDropsSmallOnes) {
  Query query;
  query.isovalue = 0;
  EXPECT_EQ(ballsOf(query, {}, 0), (Balls{0, 1, 2}));
  EXPECT_EQ(ballsOf(query, {{seed(1)}, {}, 0}, 0), (Balls{1}));
  EXPECT_EQ(ballsOf(query, {{seed(0), seed(2)}, {}, 0}, 0), (Balls{0, 2}));
  EXPECT_EQ(ballsOf(query, {{}, {seed(0)}, 0}, 0), (Balls{1, 2}));
  EXPECT_EQ(ballsOf(query, {{}, {}, 2 * seed(2).area}, 0), (Balls{0, 1}));
  EXPECT_EQ(ballsOf(query, {{}, {seed(1)}, 2 * seed(2).area}, 0), (Balls{0}));
  // A piece that was chosen stays, however small.
  EXPECT_EQ(ballsOf(query, {{seed(2)}, {}, 1e6}, 0), (Balls{2}));
}

TEST_F(ComponentChoiceTest, HoldsForOtherLevelsAndIsovalues) {
  for (const double isovalue : {-1.5, 0.0, 2.5})
    for (int detail = 0; detail < 4; ++detail) {
      SCOPED_TRACE(std::to_string(isovalue) + " detail " + std::to_string(detail));
      Query query;
      query.isovalue = isovalue;
      if (detail == 1) query.uniform_level = 1;
      if (detail == 2) query.focus = FocusSphere{glm::dvec3(50), 34};
      if (detail == 3) query.focus = FocusSphere{{25, 55, 25}, 40};
      EXPECT_EQ(ballsOf(query, {{seed(0)}, {}, 0}, 0), (Balls{0}));
      EXPECT_EQ(ballsOf(query, {{}, {seed(1)}, 0}, 0), (Balls{0, 2}));
    }
}

TEST_F(ComponentChoiceTest, APieceThatIsNotThereHasNoEffect) {
  Query query;
  query.isovalue = 7.5;  // the smallest ball is gone
  EXPECT_EQ(ballsOf(query, {{seed(2, 5)}, {}, 0}, 1), (Balls{0, 1}));
  EXPECT_EQ(ballsOf(query, {{seed(2, 5), seed(1, 5)}, {}, 0}, 1), (Balls{1}));
  EXPECT_EQ(ballsOf(query, {{}, {seed(2, 5)}, 0}, 1), (Balls{0, 1}));
  // Joined to a much larger one: what is hidden was small.
  query.isovalue = 0;
  ComponentSeed speck = seed(0);
  speck.area /= 5;
  EXPECT_EQ(ballsOf(query, {{}, {speck}, 0}, 1), (Balls{0, 1, 2}));
}

TEST_F(ComponentChoiceTest, GivesUpBeyondTheMostTriangles) {
  Query query;
  query.isovalue = 0;
  Extractor extractor(*pyramid_);
  CountingSink sink;
  EXPECT_THROW(extractChosen(extractor, query, {{seed(2)}, {}, 0}, sink, 1000), TooManyTriangles);
  EXPECT_EQ(sink.vertices(), 0u);
}

TEST_F(ComponentChoiceTest, CentreAndPointOfAComponent) {
  Query query;
  query.isovalue = 0;
  ComponentFinder finder(query, {{geometry_.indexToWorld(kCenters[1])}});
  Extractor(*pyramid_).extract(query, finder);
  const SurfaceComponents components = finder.take();
  ASSERT_EQ(components.list().size(), 3u);
  for (std::size_t i = 0; i < 3; ++i) {
    const SurfaceComponent& ball = components.list()[i];
    const glm::dvec3 center = geometry_.indexToWorld(kCenters[i]);
    EXPECT_NEAR(glm::distance(ball.center, center), 0, 0.01);
    EXPECT_NEAR(glm::distance(ball.point, center), 0.5 * kRadii[i], 0.02);
  }
  ASSERT_EQ(components.atPoints().size(), 1u);
  EXPECT_EQ(components.atPoints()[0], 1u);
}

TEST(SquaredDistance, OfFacesEdgesAndCorners) {
  const glm::dvec3 a(0, 0, 0), b(4, 0, 0), c(0, 4, 0);
  EXPECT_DOUBLE_EQ(squaredDistance({1, 1, 3}, a, b, c), 9);       // face
  EXPECT_DOUBLE_EQ(squaredDistance({2, -2, 1}, a, b, c), 5);      // edge
  EXPECT_DOUBLE_EQ(squaredDistance({3, 3, 0}, a, b, c), 2);       // long edge
  EXPECT_DOUBLE_EQ(squaredDistance({-3, -4, 12}, a, b, c), 169);  // corner
  EXPECT_DOUBLE_EQ(squaredDistance({5, 1, 0}, a, a, a), 26);      // no area
}

// Closest point by halving the triangle's own coordinates: slow, and nothing like the other.
double sampledDistance(const glm::dvec3& p, const glm::dvec3& a, const glm::dvec3& b,
                       const glm::dvec3& c) {
  double best = std::numeric_limits<double>::infinity();
  constexpr int kSteps = 400;
  for (int i = 0; i <= kSteps; ++i)
    for (int j = 0; i + j <= kSteps; ++j)
      best = std::min(best, glm::length(p - (a + (b - a) * (double(i) / kSteps) +
                                             (c - a) * (double(j) / kSteps))));
  return best;
}

TEST(SquaredDistance, IsThatToTheNearestOfManyOfTheTrianglesPoints) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> number(-1, 1);
  const auto point = [&] { return glm::dvec3(number(random), number(random), number(random)); };
  for (int i = 0; i < 60; ++i) {
    const glm::dvec3 a = point(), b = i % 5 == 0 ? a : point(), c = i % 10 == 0 ? a : point();
    const glm::dvec3 p = 2.0 * point();
    const double exact = std::sqrt(squaredDistance(p, a, b, c));
    const double sampled = sampledDistance(p, a, b, c);
    EXPECT_LE(exact, sampled + 1e-12) << i;
    EXPECT_GT(exact, sampled - 0.01) << i;
  }
}

}  // namespace
}  // namespace isobrick::test
