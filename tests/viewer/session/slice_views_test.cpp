// The flat views: which values they show, and how they follow a slice that moves.
#include <gtest/gtest.h>

#include <cmath>
#include <optional>
#include <thread>

#include "isobrick/viewer/session/plane_set.h"
#include "tests/support/field_pyramid.h"

namespace isobrick {
namespace {

class SliceViewsTest : public ::testing::Test {
 protected:
  SliceViewsTest() {
    BuildOptions options;
    options.with_curvature = false;
    volume_.voxels = {90, 70, 50};
    volume_.least_value = 0.0;
    volume_.greatest_value = 600.0;
    pyramid_ =
        std::make_shared<const Pyramid>(test::buildField(folder_, volume_.voxels, field, options));
    views_.emplace(pyramid_, 1.0);
    state_ = firstView(volume_, 1.0);
    state_.slice_views.shown = true;
  }
  static double field(const glm::dvec3& p) { return p.x + 3.0 * p.y + 5.0 * p.z; }
  void want(int view, int width, int height) {
    views_->want(view, sliceFrame(state_, volume_, view, {width, height}), width, height);
  }
  void settle() {
    do {
      views_->update();
      std::this_thread::yield();
    } while (views_->busy());
    EXPECT_EQ(views_->error(), "");
  }

  test::TemporaryFolder folder_;
  ViewVolume volume_;
  std::shared_ptr<const Pyramid> pyramid_;
  std::optional<SliceViews> views_;
  ViewState state_;
};

TEST_F(SliceViewsTest, EveryPixelHasTheValueOfItsPlace) {
  state_.slice_views.zoom = 1.7;
  state_.slice_views.center = glm::dvec3(60.0, 20.0, 30.0);
  state_.slices[2].position = 12.0;
  for (int view = 0; view < kSliceViews; ++view) want(view, 260, 190);
  settle();
  for (int view = 0; view < kSliceViews; ++view) {
    const auto& shown = views_->shown(view);
    ASSERT_TRUE(shown);
    EXPECT_EQ(shown->pixels, 1.0);
    ASSERT_EQ(shown->values.width, 260);
    ASSERT_EQ(shown->values.height, 190);
    int inside = 0, outside = 0;
    for (int y = 0; y < 190; y += 3)
      for (int x = 0; x < 260; x += 3) {
        const glm::dvec3 place = shown->frame.indexAt({x + 0.5, y + 0.5});
        const glm::dvec3 last(volume_.voxels - Index3(1));
        const std::optional<double> value = shown->valueAt({x + 0.7, y + 0.2});
        const bool is_inside = glm::all(glm::greaterThan(place, glm::dvec3(1e-3))) &&
                               glm::all(glm::lessThan(place, last - 1e-3));
        if (is_inside) {
          ASSERT_TRUE(value);
          EXPECT_NEAR(*value, field(place), 1e-3);
          ++inside;
        } else if (!value) {
          ++outside;
        }
      }
    EXPECT_GT(inside, 500) << view;
    EXPECT_GT(outside, 100) << view;
  }
  EXPECT_FALSE(views_->shown(0)->valueAt({-0.1, 3.0}));
  EXPECT_FALSE(views_->shown(0)->valueAt({3.0, 190.0}));
}

TEST_F(SliceViewsTest, ALargeViewIsCoarseFirstAndFineAtRest) {
  want(1, 1500, 1100);
  std::uint64_t first = 0;
  while (first == 0) {
    views_->update();
    if (views_->shown(1)) first = views_->shown(1)->number;
    std::this_thread::yield();
  }
  EXPECT_EQ(views_->shown(1)->pixels, 3.0);
  EXPECT_TRUE(views_->busy());
  settle();
  EXPECT_EQ(views_->shown(1)->pixels, 1.0);
  EXPECT_NE(views_->shown(1)->number, first);
}

// A slice that moves in every frame is shown at many of its places, and the last one at rest.
TEST_F(SliceViewsTest, AMovingSliceIsFollowed) {
  want(2, 900, 700);
  settle();
  std::uint64_t seen = views_->shown(2)->number;
  int pictures = 0;
  for (int i = 0; pictures < 5; ++i) {
    state_.slices[2].position = i % 50;
    want(2, 900, 700);
    views_->update();
    if (views_->shown(2)->number != seen) ++pictures;
    seen = views_->shown(2)->number;
    std::this_thread::yield();
  }
  state_.slices[2].position = 31.0;
  want(2, 900, 700);
  EXPECT_TRUE(views_->busy());
  settle();
  EXPECT_EQ(views_->shown(2)->frame.corner.z, 31.0);
}

TEST_F(SliceViewsTest, NothingIsLeftOfViewsThatAreNotShown) {
  want(0, 100, 100);
  views_->update();
  views_->forget();
  EXPECT_FALSE(views_->shown(0));
  settle();
  EXPECT_FALSE(views_->shown(0));
  EXPECT_FALSE(views_->busy());
}

// A preview has a sample for every second voxel; places are those of the volume all the same.
TEST_F(SliceViewsTest, APreviewIsShownWhereItsVolumeIs) {
  SliceViews preview(pyramid_, 2.0);
  ViewVolume volume = volume_;
  volume.voxels = volume_.voxels * std::int64_t{2};
  const ViewState state = firstView(volume, 1.0);
  const SliceFrame frame = sliceFrame(state, volume, 2, {100.0, 80.0});
  preview.want(2, frame, 100, 80);
  do preview.update();
  while (preview.busy());
  const glm::dvec3 place = frame.indexAt({50.5, 40.5});
  ASSERT_TRUE(preview.shown(2)->valueAt({50.5, 40.5}));
  EXPECT_NEAR(*preview.shown(2)->valueAt({50.5, 40.5}), field(0.5 * place), 1e-3);
}

}  // namespace
}  // namespace isobrick
