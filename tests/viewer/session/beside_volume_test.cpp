// Several volumes in one world: surfaces of each, where it lies, with its own isovalues.
#include <gtest/gtest.h>

#include <glm/geometric.hpp>
#include <thread>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/session/view_session.h"
#include "tests/support/field_pyramid.h"
#include "tests/support/keeping_renderer.h"
#include "tests/support/ply_reader.h"

namespace isobrick {
namespace {

struct WorldBall {
  GridGeometry geometry;
  glm::dvec3 center{0.0};  // world
  double radius = 0.0;     // world units, at the isovalue 0
};

class BesideVolumeTest : public ::testing::Test {
 protected:
  BesideVolumeTest() {
    first_.geometry.spacing = {1.0, 1.5, 1.0};
    first_.geometry.origin = {-40.0, 3.0, 0.0};
    first_.radius = 12.0;
    second_.geometry.spacing = glm::dvec3(0.4);
    second_.geometry.direction = glm::dmat3(0.6, 0.8, 0.0, -0.8, 0.6, 0.0, 0.0, 0.0, 1.0);
    second_.geometry.origin = {30.0, 5.0, 9.0};
    second_.radius = 5.0;
    SessionOptions options{1, std::uint64_t{1} << 30};
    options.beside.push_back(opened(second_, "second.isb"));
    session_.emplace(opened(first_, "first.isb").file, renderer_, options);
    session_->apply(InputEvent::resized(200, 100), 0.0, false);
    settle();
  }

  OpenedVolume opened(WorldBall& ball, const std::string& name) {
    ball.center = ball.geometry.indexToWorld(glm::dvec3(19.5));
    return openPyramid(test::buildField(
                           folder_, Index3(40),
                           [&](const glm::dvec3& p) {
                             const auto at = ball.geometry.indexToWorld(p);
                             return ball.radius - glm::distance(at, ball.center);
                           },
                           {}, ball.geometry, name),
                       std::uint64_t{64} << 20);
  }
  void settle() {
    do {
      session_->update(clock_ += 0.05);
      session_->draw();
      session_->noteDrawing(0.001);
      std::this_thread::yield();
    } while (!session_->settled());
  }
  // Vertices on the spheres of these radii; the rest are on neither.
  std::array<std::size_t, 3> shownOn(double first, double second) {
    const std::string path = folder_.file("shown.ply");
    session_->writeShownMesh(path);
    std::array<std::size_t, 3> counts{};
    for (const glm::dvec3& at : test::readPly(path).positions) {
      const bool on_first = std::abs(glm::distance(at, first_.center) - first) < 0.1;
      const bool on_second = std::abs(glm::distance(at, second_.center) - second) < 0.1;
      ++counts[on_first ? 0 : on_second ? 1 : 2];
    }
    return counts;
  }

  test::TemporaryFolder folder_;
  WorldBall first_, second_;
  test::KeepingRenderer renderer_;
  double clock_ = 0.0;
  std::optional<ViewSession> session_;
};

TEST_F(BesideVolumeTest, EachIsWhereItLiesInTheWorld) {
  ViewState& state = session_->state();
  ASSERT_EQ(state.surfaces.size(), 2u);
  EXPECT_EQ(state.surfaces[1].volume, 1);
  state.focus.everywhere = true;
  state.surfaces[0].isovalue = state.surfaces[1].isovalue = 0.0;
  settle();
  const auto [on_first, on_second, elsewhere] = shownOn(12.0, 5.0);
  EXPECT_GT(on_first, 1000u);
  EXPECT_GT(on_second, 1000u);
  EXPECT_EQ(elsewhere, 0u);
  EXPECT_GE(session_->status().triangles, 2 * (on_first + on_second) - 100);
  // Near and far hold both.
  for (const WorldBall& ball : {first_, second_})
    EXPECT_TRUE(glm::all(glm::lessThan(renderer_.frame().bounds.lower, ball.center)) &&
                glm::all(glm::lessThan(ball.center, renderer_.frame().bounds.upper)));
}

TEST_F(BesideVolumeTest, IsovaluesAreOfTheVolumeOfTheirSurface) {
  ViewState& state = session_->state();
  state.focus.everywhere = true;
  state.active_surface = 1;
  EXPECT_NE(&session_->activeVolume(), &session_->volume());
  EXPECT_LT(session_->activeHistogram().greatest, session_->histogram().greatest);
  state.surfaces[0].isovalue = 8.0;  // more than the second has
  state.surfaces[1].isovalue = 2.0;
  settle();
  EXPECT_EQ(state.surfaces[0].isovalue, 8.0);
  auto counts = shownOn(4.0, 3.0);
  EXPECT_GT(counts[0], 50u);
  EXPECT_GT(counts[1], 500u);
  EXPECT_EQ(counts[2], 0u);
  state.surfaces[1].isovalue = 1e6;
  settle();
  EXPECT_EQ(state.surfaces[1].isovalue, session_->activeVolume().greatest_value);
  EXPECT_EQ(session_->meshOrder("m.ply").query.isovalue, state.surfaces[1].isovalue);
  EXPECT_EQ(session_->status().limited.find("volume 2"), std::string::npos);
  // No surface of another volume takes the place of one that is not open.
  state.surfaces[1].volume = 2;
  EXPECT_THROW(session_->meshOrder("m.ply"), Error);
  EXPECT_NE(session_->status().limited.find("volume 2"), std::string::npos);
  state.surfaces[1].volume = 1;
  // One that is not shown has no triangles, whichever volume it is of.
  state.surfaces[1].isovalue = 2.0;
  state.surfaces[0].visible = false;
  settle();
  counts = shownOn(4.0, 3.0);
  EXPECT_EQ(counts[0], 0u);
  EXPECT_GT(counts[1], 500u);
}

TEST_F(BesideVolumeTest, BothOutliveTheirRenderer) {
  session_->state().focus.everywhere = true;
  settle();
  const std::uint64_t triangles = session_->status().triangles;
  session_->suspend();
  session_->resume(renderer_);
  settle();
  EXPECT_EQ(session_->status().triangles, triangles);
}

}  // namespace
}  // namespace isobrick
