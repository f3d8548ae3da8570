// Arrows and the cube, dragged at exact places.
#include "isobrick/viewer/state/scene_handles.h"

#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>

#include "isobrick/viewer/state/interaction.h"

namespace isobrick {
namespace {

using Kind = InputEvent::Kind;

// A line that passes the eye is cut at it, and goes the right way in the picture.
TEST(PixelPathTest, LinesEndInFrontOfTheEye) {
  PlacedCamera camera;  // at the origin, along +y
  camera.half_width = camera.half_height = 0.5;
  const glm::dvec2 picture(100.0, 100.0);
  const PixelPath path = pathOf(camera, picture, {{0.0, 10.0, 0.0}, {1.0, -10.0, 0.0}});
  ASSERT_EQ(path.points.size(), 1u);
  EXPECT_EQ(path.points[0], glm::dvec2(50.0, 50.0));
  ASSERT_EQ(path.lines.size(), 1u);
  EXPECT_EQ(path.lines[0][0], glm::dvec2(50.0, 50.0));
  EXPECT_GT(path.lines[0][1].x, 1000.0);  // far to the right
  EXPECT_EQ(path.lines[0][1].y, 50.0);
  // Both behind it: nothing.
  const PixelPath behind = pathOf(camera, picture, {{0.0, -1.0, 0.0}, {1.0, -10.0, 0.0}});
  EXPECT_TRUE(behind.points.empty());
  EXPECT_TRUE(behind.lines.empty());
  camera.orthographic = true;
  EXPECT_EQ(pathOf(camera, picture, {{0.0, -1.0, 0.0}, {1.0, -10.0, 0.0}}).lines.size(), 1u);
}

class SceneHandlesTest : public ::testing::TestWithParam<bool> {
 protected:
  SceneHandlesTest() {
    volume_.voxels = {101, 81, 61};
    volume_.geometry.spacing = {0.5, 1.0, 2.0};
    volume_.geometry.origin = {1000.0, -30.0, 5.0};
    interaction_.size = {800.0, 400.0};
    state_ = firstView(volume_, 2.0);
    state_.focus.everywhere = false;
    state_.camera.orthographic = GetParam();
    state_ = bounded(state_, volume_);
  }
  std::vector<SceneHandle> handles() const {
    return handlesOf(state_, volume_, interaction_.picture());
  }
  void send(Kind kind, const glm::dvec2& place) {
    InputEvent event;
    event.kind = kind;
    event.x = place.x;
    event.y = place.y;
    applyEvent(event, seconds_ += 1.0, false, volume_, interaction_, state_);
  }
  void drag(const glm::dvec2& from, const glm::dvec2& to) {
    send(Kind::kMove, from);
    send(Kind::kPress, from);
    send(Kind::kMove, 0.5 * (from + to));
    send(Kind::kMove, to);
    send(Kind::kRelease, to);
  }

  ViewVolume volume_;
  ViewState state_;
  Interaction interaction_;
  double seconds_ = 0.0;
};
INSTANTIATE_TEST_SUITE_P(Cameras, SceneHandlesTest, testing::Bool());

// Each arrow dragged to where the same arrow lies once the focus is 3 world units along it.
TEST_P(SceneHandlesTest, TheFocusGoesWhereItsArrowIsDragged) {
  state_.focus.show_sphere = false;  // its square
  ASSERT_EQ(handles().size(), 3u);
  const ViewState start = state_;
  for (int axis = 0; axis < 3; ++axis) {
    state_ = start;
    const SceneHandle handle = handles()[static_cast<std::size_t>(axis)];
    EXPECT_EQ(handle.number, axis);
    const ViewCamera camera = state_.camera;
    const auto pulled = pullOf(handle, camera, interaction_.picture(), handle.tip);
    ASSERT_TRUE(pulled);
    EXPECT_GT(*pulled, 0.0);
    // The foot is no pull, the tip is one by the arrow's length.
    EXPECT_NEAR(*pullOf(handle, camera, interaction_.picture(), handle.foot_pixel), 0.0, 1e-9);
    SceneHandle moved = handle;
    moved.foot += 3.0 * handle.direction;
    state_.focus.center = volume_.geometry.worldToIndex(moved.foot);
    const glm::dvec2 to =
        handle.tip + (handles()[static_cast<std::size_t>(axis)].foot_pixel - handle.foot_pixel);
    state_ = start;
    drag(handle.tip, to);
    EXPECT_EQ(state_.camera, camera);
    const glm::dvec3 by = state_.focus.center - start.focus.center;
    for (int other = 0; other < 3; ++other) {
      EXPECT_TRUE(other == axis || std::abs(by[other]) < 1e-9) << by[other];
    }
    // Perspective makes the way of the tip another than that of the foot.
    EXPECT_NEAR(by[axis] * volume_.geometry.spacing[axis], 3.0, GetParam() ? 1e-9 : 0.8);
    EXPECT_EQ(interaction_.drag, Interaction::Drag::kNone);
  }
}

TEST_P(SceneHandlesTest, TheSphereGrowsToWhereItsRimIsDragged) {
  state_.focus.radius = 20.0;
  ASSERT_EQ(handles().size(), 4u);
  const SceneHandle rim = handles()[3];
  EXPECT_EQ(rim.kind, SceneHandle::Kind::kRadius);
  const glm::dvec3 center = state_.focus.center;
  drag(rim.tip, 2.0 * rim.tip - rim.foot_pixel);
  EXPECT_NEAR(state_.focus.radius, 40.0, GetParam() ? 1e-9 : 1.0);
  EXPECT_EQ(state_.focus.center, center);
  state_.focus.everywhere = true;
  EXPECT_TRUE(handles().empty());
}

TEST_P(SceneHandlesTest, AClipPlaneGoesWhereItsArrowIsDragged) {
  state_.focus.everywhere = true;  // its arrows are not in the way
  const glm::dvec3 normal = glm::normalize(glm::dvec3(1.0, 0.5, 0.8));
  const glm::dvec3 middle = volume_.box().center();
  state_.clip_planes = {{normal, glm::dot(normal, middle) + 4.0, true, true},
                        {{0.0, 0.0, 1.0}, middle.z, false, true}};
  ASSERT_EQ(handles().size(), 1u);
  const SceneHandle handle = handles()[0];
  EXPECT_EQ(handle.kind, SceneHandle::Kind::kClipPlane);
  EXPECT_NEAR(glm::distance(handle.foot, middle + 4.0 * normal), 0.0, 1e-9);
  const ViewCamera camera = state_.camera;
  const glm::dvec2 to = 2.0 * handle.foot_pixel - handle.tip;
  const double by = *pullOf(handle, camera, interaction_.picture(), to) -
                    *pullOf(handle, camera, interaction_.picture(), handle.tip);
  EXPECT_LT(by, 0.0);
  drag(handle.tip, to);
  EXPECT_NEAR(state_.clip_planes[0].offset, glm::dot(normal, middle) + 4.0 + by, 1e-9);
  EXPECT_EQ(state_.clip_planes[0].normal, normal);
  EXPECT_EQ(state_.clip_planes[1].offset, middle.z);
  EXPECT_EQ(state_.camera, camera);
}

TEST_P(SceneHandlesTest, WhatCannotBeSeenCannotBeTaken) {
  state_.show_handles = false;
  EXPECT_TRUE(handles().empty());
  state_.show_handles = true;
  // Straight along an axis its arrow is a point.
  state_.camera = alongAxis(state_.camera, AxisView::kTop);
  std::vector<SceneHandle> left = handles();
  ASSERT_EQ(left.size(), 3u);  // the sphere's square, too
  EXPECT_EQ(left[0].number, 0);
  EXPECT_EQ(left[1].number, 1);
  interaction_.size = {0.0, 0.0};
  EXPECT_TRUE(handles().empty());
  EXPECT_TRUE(cubeFacesOf(state_.camera, interaction_.picture()).empty());
  interaction_.size = {200.0, 150.0};
  EXPECT_TRUE(cubeFacesOf(state_.camera, interaction_.picture()).empty());
}

TEST_P(SceneHandlesTest, AClickOnTheCubeLooksFromThatSide) {
  const auto faces = cubeFacesOf(state_.camera, interaction_.picture());
  ASSERT_EQ(faces.size(), 3u);  // from the front, a little from the right and from above
  const ViewState start = state_;
  for (const CubeFace& face : faces) {
    EXPECT_TRUE(face.view == AxisView::kFront || face.view == AxisView::kRight ||
                face.view == AxisView::kTop);
    state_ = start;
    const glm::dvec2 middle = 0.5 * (face.corners[0] + face.corners[2]);
    EXPECT_EQ(cubeFaceAt(faces, middle), face.view);
    drag(middle, middle);
    EXPECT_EQ(state_.camera, alongAxis(start.camera, face.view));
  }
  EXPECT_EQ(cubeFaceAt(faces, glm::dvec2(400.0, 200.0)), std::nullopt);
  // Dragged it turns the view, as the scene does.
  state_ = start;
  const glm::dvec2 middle = 0.5 * (faces[0].corners[0] + faces[0].corners[2]);
  drag(middle, middle - glm::dvec2(60.0, 0.0));
  ViewState turned = start;
  std::swap(turned, state_);
  const ViewCamera by_cube = turned.camera;
  drag(glm::dvec2(700.0, 380.0), glm::dvec2(640.0, 380.0));
  EXPECT_EQ(by_cube, state_.camera);
}

TEST_P(SceneHandlesTest, OnlyOneFaceIsSeenStraightOn) {
  state_.camera = alongAxis(state_.camera, AxisView::kLeft);
  const auto faces = cubeFacesOf(state_.camera, interaction_.picture());
  ASSERT_EQ(faces.size(), 1u);
  EXPECT_EQ(faces[0].view, AxisView::kLeft);
  EXPECT_NEAR(faces[0].toward, 1.0, 1e-12);
}

TEST_P(SceneHandlesTest, TheFocusFollowsTheViewUntilItIsTaken) {
  state_.focus.follow_view = true;
  state_.camera.pivot = volume_.geometry.indexToWorld({20.0, 30.0, 40.0});
  state_ = bounded(state_, volume_);
  EXPECT_NEAR(glm::distance(state_.focus.center, glm::dvec3(20.0, 30.0, 40.0)), 0.0, 1e-9);
  // Turning about it changes nothing, moving does.
  const glm::dvec3 before = state_.focus.center;
  state_.camera = orbited(state_.camera, 30.0, 10.0);
  EXPECT_EQ(bounded(state_, volume_).focus.center, before);
  state_.camera = panned(state_.camera, {0.1, 0.0}, 2.0);
  state_ = bounded(state_, volume_);
  EXPECT_NE(state_.focus.center, before);
  const SceneHandle handle = handles()[0];
  drag(handle.tip, handle.tip + glm::dvec2(5.0, 0.0));
  EXPECT_FALSE(state_.focus.follow_view);
}

// Screens of many pixels have larger grips.
TEST_P(SceneHandlesTest, GripsGrowWithTheScreensScale) {
  const auto tip_at = [&](double scale) {
    interaction_.scale = scale;
    const SceneHandle handle = handles()[0];
    return glm::distance(handle.tip, handle.foot_pixel);
  };
  const double ordinary = tip_at(1.0);
  EXPECT_NEAR(tip_at(2.0), 2.0 * ordinary, (GetParam() ? 1e-9 : 0.2) * ordinary);
  const SceneHandle handle = handles()[0];
  EXPECT_TRUE(handleAt(handles(), handle.tip + glm::dvec2(0.0, 15.0), 2.0));
  EXPECT_FALSE(handleAt(handles(), handle.tip + glm::dvec2(0.0, 15.0), 1.0));
}

}  // namespace
}  // namespace isobrick
