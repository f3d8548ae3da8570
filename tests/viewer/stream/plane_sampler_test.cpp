// Values on planes, and how often values occur, of fields that are known.
#include "isobrick/viewer/stream/plane_sampler.h"

#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/stream/value_histogram.h"
#include "tests/support/field_pyramid.h"

namespace isobrick {
namespace {

const glm::dvec3 kSlope(3.0, -2.0, 0.5);

class PlaneSamplerTest : public ::testing::Test {
 protected:
  PlaneSamplerTest() {
    BuildOptions options;
    options.brick_cells = 8;
    geometry_.spacing = {1.0, 2.0, 0.5};
    geometry_.origin = {10.0, -20.0, 30.0};
    pyramid_ = std::make_unique<Pyramid>(test::buildField(
        folder_, Index3(33, 20, 27), [](const glm::dvec3& p) { return glm::dot(kSlope, p); },
        options, geometry_));
  }

  test::TemporaryFolder folder_;
  GridGeometry geometry_;
  std::unique_ptr<Pyramid> pyramid_;
  CancelFlag cancel_;
};

// The low-pass keeps linear fields, so every level gives the same values.
TEST_F(PlaneSamplerTest, ALinearFieldIsExactOnEveryLevel) {
  const IndexPlane plane{{1.0, 2.0, 3.0}, {20.0, 3.0, 10.0}, {2.0, 14.0, -3.0}};
  for (const int level : {0, 1, 2}) {
    const PlaneSampling sampling{level, 23, 17};
    const SliceImage image = samplePlane(*pyramid_, plane, sampling, cancel_);
    ASSERT_EQ(image.values.size(), 23u * 17u);
    for (int y = 0; y < 17; ++y)
      for (int x = 0; x < 23; ++x)
        ASSERT_NEAR(
            image.values[static_cast<std::size_t>(23 * y + x)],
            glm::dot(kSlope, plane.corner + plane.across * (x / 22.0) + plane.along * (y / 16.0)),
            1e-4)
            << level << ' ' << x << ' ' << y;
  }
}

TEST_F(PlaneSamplerTest, OutsideOfTheVolumeThereIsNoValue) {
  const IndexPlane plane{{-10.0, 5.0, 5.0}, {60.0, 0.0, 0.0}, {0.0, 5.0, 0.0}};
  const SliceImage image = samplePlane(*pyramid_, plane, {0, 61, 2}, cancel_);
  for (int x = 0; x < 61; ++x)
    EXPECT_EQ(std::isnan(image.values[static_cast<std::size_t>(x)]), x < 10 || x > 42) << x;
}

TEST_F(PlaneSamplerTest, SlicesReachFromBorderToBorder) {
  const IndexPlane plane = slicePlane({33, 20, 27}, 1, 7.0);
  const PlaneSampling sampling = samplingOf(pyramid_->lattice(), plane, 1000);
  EXPECT_EQ(sampling.level, 0);
  EXPECT_EQ(sampling.width, 27);
  EXPECT_EQ(sampling.height, 33);
  const SliceImage image = samplePlane(*pyramid_, plane, sampling, cancel_);
  EXPECT_NEAR(image.values.front(), -14.0, 1e-4);
  EXPECT_NEAR(image.values.back(), glm::dot(kSlope, glm::dvec3(32.0, 7.0, 26.0)), 1e-4);
  const PlaneSampling coarse = samplingOf(pyramid_->lattice(), plane, 10);
  EXPECT_EQ(coarse.level, 2);
  EXPECT_LE(coarse.height, 10);
}

TEST_F(PlaneSamplerTest, CapsLieInTheirPlaneAndCoverTheBox) {
  const glm::dvec3 normal = glm::normalize(glm::dvec3(1.0, 2.0, -0.5));
  const glm::dvec3 middle = geometry_.indexToWorld({16.0, 10.0, 13.0});
  const auto plane = capPlane({33, 20, 27}, geometry_, normal, glm::dot(normal, middle));
  ASSERT_TRUE(plane);
  for (const auto& [u, v] : {std::pair{0.0, 0.0}, {1.0, 0.0}, {0.0, 1.0}, {0.3, 0.8}}) {
    const glm::dvec3 world =
        geometry_.indexToWorld(plane->corner + u * plane->across + v * plane->along);
    EXPECT_NEAR(glm::dot(normal, world), glm::dot(normal, middle), 1e-9);
  }
  EXPECT_FALSE(capPlane({33, 20, 27}, geometry_, normal, 1e6));
}

TEST_F(PlaneSamplerTest, ACancelledSliceIsGivenUp) {
  cancel_.request();
  EXPECT_THROW(samplePlane(*pyramid_, slicePlane({33, 20, 27}, 0, 1.0), {0, 20, 27}, cancel_),
               Cancelled);
}

TEST(ValueHistogramTest, EveryVoxelIsCountedOnce) {
  const test::TemporaryFolder folder;
  BuildOptions options;
  options.brick_cells = 8;
  // 10 in two slabs of 6 of 21 slices, else 90.
  const Pyramid pyramid(test::buildField<std::uint8_t>(
      folder, Index3(19, 21, 17), [](const glm::dvec3& p) { return p.y < 6.0 ? 10.0 : 90.0; },
      options));
  const ValueHistogram histogram = histogramOf(pyramid, 8);
  EXPECT_EQ(histogram.least, 10.0);
  EXPECT_EQ(histogram.greatest, 90.0);
  EXPECT_EQ(histogram.total(), 19u * 21u * 17u);
  EXPECT_EQ(histogram.counts.front(), 19u * 6u * 17u);
  EXPECT_EQ(histogram.counts.back(), 19u * 15u * 17u);
  ASSERT_FALSE(histogram.isovalues.empty());
  EXPECT_GT(histogram.isovalues.front(), 10.0);
  EXPECT_LT(histogram.isovalues.front(), 90.0);
}

}  // namespace
}  // namespace isobrick
