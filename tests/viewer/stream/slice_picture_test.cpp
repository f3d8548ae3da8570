#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "isobrick/viewer/stream/plane_sampler.h"

namespace isobrick {
namespace {

template <typename F>
SliceImage imageOf(int width, int height, F&& value) {
  SliceImage image{width, height, {}};
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) image.values.push_back(static_cast<float>(value(x, y)));
  return image;
}

TEST(SlicePictureTest, TheWindowIsFromBlackToWhite) {
  const SliceImage ramp = imageOf(5, 2, [](int x, int) { return 100.0 * x; });
  const PictureBytes picture = drawSlice(ramp, {100.0, 300.0}, {}, 1.5);
  ASSERT_EQ(picture.width, 5);
  const int grey[] = {0, 0, 128, 255, 255};
  for (int x = 0; x < 5; ++x)
    for (std::size_t c = 0; c < 3; ++c)
      EXPECT_EQ(picture.rgba[picture.offsetOf(x, 1) + c], grey[x]) << x;
  // A window without a width has an edge.
  const PictureBytes edge = drawSlice(ramp, {200.0, 200.0}, {}, 1.5);
  EXPECT_EQ(edge.rgba[edge.offsetOf(1, 0)], 0);
  EXPECT_EQ(edge.rgba[edge.offsetOf(3, 0)], 255);
}

TEST(SlicePictureTest, NoValueIsDarkAndHasNoLineBesideIt) {
  const float none = std::numeric_limits<float>::quiet_NaN();
  const SliceImage half =
      imageOf(8, 8, [&](int x, int) { return x < 4 ? static_cast<double>(none) : 100.0; });
  const SliceContour red{50.0, {1.0f, 0.0f, 0.0f}};
  const PictureBytes picture = drawSlice(half, {0.0, 100.0}, {&red, 1}, 2.0);
  for (int x = 0; x < 8; ++x) {
    const std::size_t at = picture.offsetOf(x, 3);
    EXPECT_EQ(picture.rgba[at], picture.rgba[at + 1]) << x;
    EXPECT_EQ(picture.rgba[at] < 30, x < 4) << x;
  }
}

// The red of all pixels together is the area of a ring, as wide as asked for, whatever the slope
// of the values is.
TEST(SlicePictureTest, AContourIsAsWideAndAsLongAsItShouldBe) {
  constexpr double kRadius = 40.0;
  for (const double slope : {0.01, 1.0, 1000.0}) {
    for (const double width : {1.0, 1.5, 3.0}) {
      const SliceImage disc = imageOf(101, 101, [&](int x, int y) {
        return slope * (std::hypot(x - 50.3, y - 49.8) - kRadius);
      });
      const SliceContour red{0.0, {1.0f, 0.0f, 0.0f}};
      const PictureBytes picture =
          drawSlice(disc, {1e9, 2e9}, {&red, 1}, width);  // black but for the line
      double area = 0.0;
      for (int y = 0; y < 101; ++y)
        for (int x = 0; x < 101; ++x) {
          const double share = picture.rgba[picture.offsetOf(x, y)] / 255.0;
          area += share;
          const double distance = std::abs(std::hypot(x - 50.3, y - 49.8) - kRadius);
          if (distance > 0.5 * width + 0.75) {
            EXPECT_EQ(share, 0.0) << x << " " << y;
          }
        }
      EXPECT_NEAR(area, 2.0 * std::numbers::pi * kRadius * width,
                  0.12 * 2.0 * std::numbers::pi * kRadius * width)
          << slope << " " << width;
    }
  }
}

// Between voxels of two values, as in a mask, the line is as wide as any other.
TEST(SlicePictureTest, AStepOfOnePixelHasAThinLine) {
  const SliceImage step = imageOf(9, 5, [](int x, int) { return x < 5 ? 0.0 : 1.0; });
  const SliceContour red{0.5, {1.0f, 0.0f, 0.0f}};
  const PictureBytes picture = drawSlice(step, {10.0, 20.0}, {&red, 1}, 1.0);
  double wide = 0.0;
  for (int x = 0; x < 9; ++x) wide += picture.rgba[picture.offsetOf(x, 2)] / 255.0;
  EXPECT_NEAR(wide, 1.0, 0.02);
}

}  // namespace
}  // namespace isobrick
