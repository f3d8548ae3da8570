// Cameras as arithmetic: what stays where it was in the picture, and how distance becomes depth.
#include "isobrick/viewer/state/view_camera.h"

#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>

namespace isobrick {
namespace {

constexpr double kAspect = 1.5;

glm::dvec2 pictureOf(const PlacedCamera& camera, const glm::dvec3& point) {
  const glm::dvec3 arm = point - camera.eye;
  const double depth = camera.orthographic ? 1.0 : glm::dot(arm, camera.forward);
  return {glm::dot(arm, camera.right) / (depth * camera.half_width),
          glm::dot(arm, camera.up) / (depth * camera.half_height)};
}

ViewCamera someCamera(bool orthographic) {
  ViewCamera camera;
  camera.pivot = {3.0, -7.0, 20.0};
  camera.distance = 12.0;
  camera.azimuth = 40.0;
  camera.elevation = -25.0;
  camera.orthographic = orthographic;
  return camera;
}

TEST(ViewCameraTest, AxesAreOrthonormalAndAimAtThePivotFromEverywhere) {
  ViewCamera camera = someCamera(false);
  for (camera.elevation = -90.0; camera.elevation <= 90.0; camera.elevation += 30.0) {
    for (camera.azimuth = -180.0; camera.azimuth <= 180.0; camera.azimuth += 45.0) {
      const PlacedCamera placed = placeCamera(camera, kAspect);
      EXPECT_NEAR(glm::length(placed.forward), 1.0, 1e-12);
      EXPECT_NEAR(glm::length(placed.up), 1.0, 1e-12);
      EXPECT_LT(glm::distance(glm::cross(placed.right, placed.up), -placed.forward), 1e-12);
      EXPECT_LT(glm::length(pictureOf(placed, camera.pivot)), 1e-12);
      EXPECT_NEAR(placed.half_width / placed.half_height, kAspect, 1e-12);
    }
  }
}

TEST(ViewCameraTest, AxisViewsLookAlongTheirAxes) {
  const auto forward = [](AxisView view) {
    return placeCamera(alongAxis(someCamera(false), view), 1.0).forward;
  };
  EXPECT_LT(glm::distance(forward(AxisView::kFront), glm::dvec3(0, 1, 0)), 1e-12);
  EXPECT_LT(glm::distance(forward(AxisView::kBack), glm::dvec3(0, -1, 0)), 1e-12);
  EXPECT_LT(glm::distance(forward(AxisView::kRight), glm::dvec3(-1, 0, 0)), 1e-12);
  EXPECT_LT(glm::distance(forward(AxisView::kLeft), glm::dvec3(1, 0, 0)), 1e-12);
  EXPECT_LT(glm::distance(forward(AxisView::kTop), glm::dvec3(0, 0, -1)), 1e-12);
  EXPECT_LT(glm::distance(forward(AxisView::kBottom), glm::dvec3(0, 0, 1)), 1e-12);
}

TEST(ViewCameraTest, AFramedBoxFillsThePictureAndStaysInIt) {
  const WorldBox box{{-100.0, 40.0, 7.0}, {30.0, 80.0, 290.0}};
  for (const bool orthographic : {false, true}) {
    const ViewCamera camera = framed(someCamera(orthographic), box, kAspect);
    EXPECT_EQ(camera.pivot, box.center());
    double furthest = 0.0;
    for (const glm::dvec3& corner : cornersOf(box)) {
      const glm::dvec2 place = pictureOf(placeCamera(camera, kAspect), corner);
      furthest = std::max({furthest, std::abs(place.x), std::abs(place.y)});
    }
    EXPECT_NEAR(furthest, 1.0 / 1.06, 1e-9);
  }
}

TEST(ViewCameraTest, ZoomKeepsWhatIsUnderTheCursor) {
  const glm::dvec2 cursor(0.6, -0.3);
  for (const bool orthographic : {false, true}) {
    const ViewCamera before = someCamera(orthographic);
    const PlacedCamera placed = placeCamera(before, kAspect);
    const PictureRay ray = rayThrough(placed, cursor);
    const glm::dvec3 under = ray.at(before.distance);
    for (const double factor : {0.3, 1.0, 2.5}) {
      const ViewCamera after = zoomed(before, factor, cursor, kAspect, 0.1, 1e3);
      EXPECT_NEAR(after.distance, factor * before.distance, 1e-12);
      EXPECT_LT(glm::distance(pictureOf(placeCamera(after, kAspect), under), cursor), 1e-12);
    }
  }
  EXPECT_EQ(zoomed(someCamera(false), 1e-9, cursor, kAspect, 0.5, 50.0).distance, 0.5);
  EXPECT_EQ(zoomed(someCamera(false), 1e9, cursor, kAspect, 0.5, 50.0).distance, 50.0);
}

TEST(ViewCameraTest, PanMovesThePivotByTheShift) {
  const ViewCamera before = someCamera(false);
  const ViewCamera after = panned(before, {0.25, -0.5}, kAspect);
  const glm::dvec2 seen = pictureOf(placeCamera(after, kAspect), before.pivot);
  EXPECT_LT(glm::distance(seen, glm::dvec2(0.25, -0.5)), 1e-12);
}

TEST(ViewCameraTest, OrbitKeepsThePivotAndLookingAroundKeepsTheEye) {
  const ViewCamera before = someCamera(false);
  const ViewCamera orbit = orbited(before, 300.0, 200.0);
  EXPECT_EQ(orbit.pivot, before.pivot);
  EXPECT_NEAR(orbit.azimuth, -20.0, 1e-12);
  EXPECT_EQ(orbit.elevation, 90.0);

  const ViewCamera look = lookedAround(before, 30.0, 10.0);
  const PlacedCamera a = placeCamera(before, 1.0), b = placeCamera(look, 1.0);
  EXPECT_LT(glm::distance(a.eye, b.eye), 1e-12);
  EXPECT_GT(glm::dot(b.forward, a.right), 0.3);  // to the right
  EXPECT_GT(b.forward.z, a.forward.z);           // and up

  const ViewCamera flight = flown(before, {1.0, 2.0, 3.0});
  const glm::dvec3 way = placeCamera(flight, 1.0).eye - a.eye;
  EXPECT_LT(glm::distance(way, a.right + 2.0 * a.up + 3.0 * a.forward), 1e-12);
}

TEST(ViewCameraTest, DepthIsReversedAndHoldsTheScene) {
  const WorldBox box{glm::dvec3(-1.0), glm::dvec3(1.0)};
  for (const bool orthographic : {false, true}) {
    ViewCamera camera;
    camera.distance = 10.0;
    camera.orthographic = orthographic;
    const PlacedCamera placed = placeCamera(camera, 1.0);
    const DepthRange range = depthRangeOf(box, placed);
    const DepthProjection depth = reversedDepth(range, orthographic);
    EXPECT_NEAR(depth.depthAt(range.near), 1.0, 1e-12);
    EXPECT_NEAR(depth.depthAt(range.far), 0.0, 1e-12);
    for (const glm::dvec3& corner : cornersOf(box)) {
      const double distance = glm::dot(corner - placed.eye, placed.forward);
      EXPECT_GT(depth.depthAt(distance), 0.0);
      EXPECT_LT(depth.depthAt(distance), 1.0);
      EXPECT_NEAR(depth.distanceAt(depth.depthAt(distance)), distance, 1e-9);
    }
    // Nearer is greater.
    EXPECT_GT(depth.depthAt(9.0), depth.depthAt(9.5));
  }
}

// The eye inside a volume of 4,000 voxels: a tenth of a voxel is told apart over all of it, where
// depth that is 0 at the near plane loses it at a twentieth of the way.
TEST(ViewCameraTest, ReversedDepthTellsFarPointsApart) {
  const DepthRange range{0.4, 4000.0};
  const DepthProjection reversed = reversedDepth(range, false);
  const auto plain = [&](double d) { return static_cast<float>(1.0 - reversed.depthAt(d)); };
  for (double d = 1.0; d < 3990.0; d *= 1.5)
    EXPECT_GT(static_cast<float>(reversed.depthAt(d)),
              static_cast<float>(reversed.depthAt(d + 0.1)))
        << d;
  EXPECT_EQ(plain(3000.0), plain(3000.1));
}

TEST(ViewCameraTest, DepthRangesSurviveTheEyeInsideAndBehind) {
  const WorldBox box{glm::dvec3(-1.0), glm::dvec3(1.0)};
  PlacedCamera inside;
  const DepthRange range = depthRangeOf(box, inside);
  EXPECT_GT(range.near, 0.0);
  EXPECT_GT(range.far, 1.0);
  PlacedCamera behind;
  behind.eye = {0.0, 10.0, 0.0};  // looks away from the box
  EXPECT_GT(depthRangeOf(box, behind).near, 0.0);
  EXPECT_LT(depthRangeOf(box, behind).near, depthRangeOf(box, behind).far);
  PlacedCamera parallel = behind;
  parallel.orthographic = true;  // sees what is behind its eye
  EXPECT_LT(depthRangeOf(box, parallel).near, -10.0);
  EXPECT_LT(depthRangeOf(emptyWorldBox(), inside).near, depthRangeOf(emptyWorldBox(), inside).far);
}

}  // namespace
}  // namespace isobrick
