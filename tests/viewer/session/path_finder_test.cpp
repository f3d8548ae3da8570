// Distances over the surface in a session without a window: found beside the frames, the newest
// first.
#include "isobrick/viewer/session/path_finder.h"

#include <gtest/gtest.h>

#include <chrono>
#include <glm/geometric.hpp>
#include <numbers>
#include <thread>

#include "isobrick/viewer/session/view_session.h"
#include "tests/support/null_renderer.h"
#include "tests/support/two_balls.h"

namespace isobrick {
namespace {

using test::kLarge;
using test::kLargeRadius;
using test::kSmall;
using test::kSmallRadius;

class PathFinderTest : public ::testing::Test {
 protected:
  PathFinderTest() { pyramid_ = test::openTwoBalls(folder_); }
  // On one of the balls, or between both.
  ViewMeasurement across(const glm::dvec3& from, const glm::dvec3& to) const {
    return {{geometry_.indexToWorld(from), geometry_.indexToWorld(to)}, 0.0};
  }
  ViewMeasurement acrossLarge() const {
    return across(kLarge + glm::dvec3(kLargeRadius, 0, 0), kLarge - glm::dvec3(0, kLargeRadius, 0));
  }
  ViewMeasurement acrossSmall() const {
    return across(kSmall + glm::dvec3(kSmallRadius, 0, 0), kSmall - glm::dvec3(0, kSmallRadius, 0));
  }
  static void finish(PathFinder& finder, const std::vector<ViewMeasurement>& wanted) {
    do {
      finder.update(wanted);
      std::this_thread::yield();
    } while (finder.busy());
  }

  const test::TemporaryFolder folder_;
  const GridGeometry geometry_ = test::twoBallsGeometry();
  std::shared_ptr<const Pyramid> pyramid_;
};

TEST_F(PathFinderTest, FindsAllOfThemAndKeepsThem) {
  PathFinder finder(pyramid_, 2, 0);
  const ViewMeasurement straight{acrossLarge().points};
  const std::vector<ViewMeasurement> wanted{straight, acrossLarge(), acrossSmall()};
  EXPECT_EQ(finder.pathOf(acrossLarge()), nullptr);
  finish(finder, wanted);
  EXPECT_EQ(finder.pathOf(straight), nullptr);
  for (const auto& [measurement, radius] :
       {std::pair{acrossLarge(), kLargeRadius}, std::pair{acrossSmall(), kSmallRadius}}) {
    const FoundPath* const found = finder.pathOf(measurement);
    ASSERT_NE(found, nullptr);
    EXPECT_EQ(found->error, "");
    const double expected = 0.5 * radius * std::numbers::pi / 2.0;
    EXPECT_NEAR(found->path.length, expected, 0.01 * expected);
  }
  // A measurement that an undo brings back is not looked for again.
  finder.update({});
  finder.update(wanted);
  EXPECT_FALSE(finder.busy());
  EXPECT_NE(finder.asked()(acrossLarge()), nullptr);
}

TEST_F(PathFinderTest, ANewerOneComesFirstAndOneThatGoesIsGivenUp) {
  PathFinder finder(pyramid_, 1, 0);
  finder.update({acrossLarge()});
  EXPECT_TRUE(finder.busy());
  finder.update({acrossLarge(), acrossSmall()});
  while (finder.pathOf(acrossSmall()) == nullptr) {
    EXPECT_EQ(finder.pathOf(acrossLarge()), nullptr);
    std::this_thread::yield();
    finder.update({acrossLarge(), acrossSmall()});
  }
  finder.update({acrossSmall()});
  EXPECT_FALSE(finder.busy());
  finish(finder, {acrossLarge()});
  EXPECT_NE(finder.pathOf(acrossLarge()), nullptr);
}

TEST_F(PathFinderTest, TwoPiecesHaveNone) {
  PathFinder finder(pyramid_, 2, 0);
  const ViewMeasurement apart =
      across(kLarge + glm::dvec3(kLargeRadius, 0, 0), kSmall - glm::dvec3(kSmallRadius, 0, 0));
  finish(finder, {apart});
  EXPECT_EQ(finder.pathOf(apart)->error,
            "no path over the surface: the points lie on different pieces of it");
}

TEST_F(PathFinderTest, ASessionSettlesWhenAllAreFound) {
  NullRenderer renderer;
  ViewSession session(pyramid_, renderer, SessionOptions{2});
  session.state().surfaces[0].isovalue = 0.0;
  session.state().measurements = {acrossLarge()};
  double clock = 0.0;
  do {
    session.update(clock += 0.05);
    session.draw();
    session.noteDrawing(0.001);
    std::this_thread::yield();
  } while (!session.settled());
  EXPECT_NE(session.paths().pathOf(session.state().measurements[0]), nullptr);
}

}  // namespace
}  // namespace isobrick
