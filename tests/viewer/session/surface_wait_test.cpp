// What the age of a surface divides into.
#include <gtest/gtest.h>

#include "isobrick/viewer/session/surface_pace.h"

namespace isobrick {
namespace {

TEST(SurfaceWaitTest, ThePartsAreTheWhole) {
  const SurfaceWait wait = surfaceWait(0.200, 0.060, 0.090, 0.070);
  EXPECT_DOUBLE_EQ(wait.before, 0.050);
  EXPECT_DOUBLE_EQ(wait.extraction, 0.060);
  EXPECT_DOUBLE_EQ(wait.uploads, 0.020);
  EXPECT_DOUBLE_EQ(wait.drawing, 0.070);
  EXPECT_DOUBLE_EQ(wait.total(), 0.200);
}

// A pass may have begun before the request that it answers, or have been there before the frame.
TEST(SurfaceWaitTest, NoPartIsLongerThanTheWhole) {
  const SurfaceWait early = surfaceWait(0.020, 0.060, 0.005, 0.050);
  EXPECT_DOUBLE_EQ(early.drawing, 0.005);
  EXPECT_DOUBLE_EQ(early.extraction, 0.015);
  EXPECT_DOUBLE_EQ(early.total(), 0.020);
  const SurfaceWait late = surfaceWait(0.020, 0.060, 0.050, 0.001);
  EXPECT_DOUBLE_EQ(late.uploads, 0.019);
  EXPECT_DOUBLE_EQ(late.extraction, 0.0);
  EXPECT_DOUBLE_EQ(late.total(), 0.020);
  EXPECT_DOUBLE_EQ(surfaceWait(-1.0, 1.0, 1.0, 1.0).total(), 0.0);
}

TEST(SurfaceWaitTest, DrawingIsCountedFromAMomentOn) {
  DrawingTimes times;
  times.add(1.0, 1.5);
  times.add(2.0, 2.25);
  EXPECT_DOUBLE_EQ(times.since(0.0), 0.75);
  EXPECT_DOUBLE_EQ(times.since(1.25), 0.5);
  EXPECT_DOUBLE_EQ(times.since(1.75), 0.25);
  EXPECT_DOUBLE_EQ(times.since(2.25), 0.0);
  for (int i = 0; i < 1000; ++i) times.add(10.0 + i, 10.5 + i);
  EXPECT_DOUBLE_EQ(times.since(0.0), 120.0);
}

}  // namespace
}  // namespace isobrick
