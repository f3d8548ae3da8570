// Views all around, and on the way from one to another.
#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>

#include "isobrick/viewer/state/view_history.h"

namespace isobrick {
namespace {

TEST(ViewPathTest, ATurntableGoesAllAroundInEqualSteps) {
  ViewState view;
  view.camera.azimuth = 170.0;
  const std::vector<ViewState> views = turntable(view, 8);
  ASSERT_EQ(views.size(), 8u);
  EXPECT_EQ(views[0], view);
  for (std::size_t i = 0; i < 8; ++i) {
    const double turned = std::remainder(
        views[i].camera.azimuth - view.camera.azimuth - 45.0 * static_cast<double>(i), 360.0);
    EXPECT_NEAR(turned, 0.0, 1e-9);
    EXPECT_LE(std::abs(views[i].camera.azimuth), 180.0);
    ViewState back = views[i];
    back.camera.azimuth = 170.0;
    EXPECT_EQ(back, view);  // nothing else changes
  }
}

TEST(ViewPathTest, TheWayIsTheShorterOneAndEndsAtItsEnds) {
  ViewState a, b;
  a.camera = {{0.0, 0.0, 0.0}, 100.0, 170.0, -20.0, 30.0, false};
  b.camera = {{8.0, -4.0, 2.0}, 25.0, -170.0, 40.0, 50.0, true};
  a.surfaces = {{100.0, {1.0f, 0.0f, 0.0f}, 1.0, true}, {300.0, glm::vec3(0.5f), 1.0, false}};
  b.surfaces = {{200.0, {0.0f, 0.0f, 1.0f}, 0.5, true}, {300.0, glm::vec3(0.5f), 0.8, true}};
  a.focus.radius = 10.0, b.focus.radius = 30.0;
  a.clip_planes = {{{1.0, 0.0, 0.0}, 0.0, true, true}};
  b.clip_planes = {{{0.0, 1.0, 0.0}, 12.0, true, true}};
  EXPECT_EQ(viewBetween(a, b, 0.0), a);
  EXPECT_EQ(viewBetween(a, b, 1.0), b);
  const ViewState middle = viewBetween(a, b, 0.5);
  EXPECT_NEAR(std::abs(middle.camera.azimuth), 180.0, 1e-9);
  EXPECT_NEAR(middle.camera.distance, 50.0, 1e-9);  // the geometric mean
  EXPECT_EQ(middle.camera.pivot, glm::dvec3(4.0, -2.0, 1.0));
  EXPECT_EQ(middle.camera.elevation, 10.0);
  EXPECT_FALSE(middle.camera.orthographic);  // that of the last stop
  EXPECT_EQ(middle.surfaces[0].isovalue, 150.0);
  EXPECT_EQ(middle.surfaces[0].opacity, 0.75);
  EXPECT_TRUE(middle.surfaces[1].visible);  // it comes by its opacity
  EXPECT_EQ(middle.surfaces[1].opacity, 0.4);
  EXPECT_EQ(middle.focus.radius, 20.0);
  EXPECT_NEAR(glm::length(middle.clip_planes[0].normal), 1.0, 1e-12);
  EXPECT_EQ(middle.clip_planes[0].offset, 6.0);
  // Other numbers of things have no way between them.
  b.surfaces.pop_back();
  EXPECT_EQ(viewBetween(a, b, 0.5).surfaces, a.surfaces);
  // Nor have opposite planes.
  b.clip_planes[0].normal = {-1.0, 0.0, 0.0};
  EXPECT_EQ(viewBetween(a, b, 0.5).clip_planes[0].normal, glm::dvec3(1.0, 0.0, 0.0));
}

TEST(ViewPathTest, APathPassesItsStops) {
  std::vector<ViewState> stops(4, ViewState());
  for (std::size_t i = 0; i < 4; ++i) stops[i].camera.pivot.x = static_cast<double>(i * i);
  const std::vector<ViewState> views = viewsAlong(stops, 10);  // three steps from stop to stop
  ASSERT_EQ(views.size(), 10u);
  for (std::size_t i = 0; i < 4; ++i) EXPECT_EQ(views[3 * i], stops[i]) << i;
  for (std::size_t i = 1; i < 10; ++i)
    EXPECT_GT(views[i].camera.pivot.x, views[i - 1].camera.pivot.x);
  const std::vector<ViewState> ends = viewsAlong(stops, 2);
  EXPECT_EQ(ends[0], stops[0]);
  EXPECT_EQ(ends[1], stops[3]);
}

}  // namespace
}  // namespace isobrick
