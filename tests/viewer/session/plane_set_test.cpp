// Slices and caps: how finely they are sampled, and what happens to those that move.
#include "isobrick/viewer/session/plane_set.h"

#include <gtest/gtest.h>

#include <optional>
#include <set>
#include <thread>

#include "isobrick/storage/error.h"
#include "tests/support/field_pyramid.h"
#include "tests/support/null_renderer.h"

namespace isobrick {
namespace {

class PlaneSetTest : public ::testing::Test {
 protected:
  static constexpr std::int64_t kSide = 1200;

  PlaneSetTest() {
    BuildOptions options;
    options.with_curvature = false;
    pyramid_ = std::make_shared<const Pyramid>(test::buildField(
        folder_, Index3(kSide, kSide, 3), [](const glm::dvec3& p) { return p.x - p.y; }, options));
    planes_.emplace(pyramid_, 1.0);
  }
  ~PlaneSetTest() override {
    planes_->release(renderer_);
    EXPECT_TRUE(renderer_.slices().empty());
  }
  static WantedPlane sliceAt(double z, int most) {
    return {slicePlane(Index3(kSide, kSide, 3), 2, z), -1, 2, most};
  }
  void frame(const WantedPlane& wanted) {
    UploadAllowance allowance;
    planes_->update(renderer_, {wanted}, allowance);
    std::this_thread::yield();
  }
  void settle(const WantedPlane& wanted) {
    do frame(wanted);
    while (planes_->busy());
  }
  int widthOf(const WantedPlane& wanted) const {
    const auto shown = planes_->shown(wanted);
    return shown ? renderer_.slices().at(shown->image).width : 0;
  }

  test::TemporaryFolder folder_;
  std::shared_ptr<const Pyramid> pyramid_;
  NullRenderer renderer_;
  std::optional<PlaneSet> planes_;
};

TEST_F(PlaneSetTest, EveryVoxelIsSampledIfAPictureCanShowIt) {
  settle(sliceAt(1.0, 512));
  EXPECT_EQ(widthOf(sliceAt(1.0, 512)), 301);  // level 2
  settle(sliceAt(1.0, 2048));
  EXPECT_EQ(widthOf(sliceAt(1.0, 2048)), kSide);
  // Further away it stays: it is there.
  settle(sliceAt(1.0, 512));
  EXPECT_EQ(widthOf(sliceAt(1.0, 512)), kSide);
}

TEST_F(PlaneSetTest, ASliceIsNoLargerThanTheCardTakes) {
  renderer_.greatest_slice = 256;
  settle(sliceAt(1.0, 2048));
  EXPECT_EQ(widthOf(sliceAt(1.0, 2048)), 151);  // level 3
}

// Quick ones come while it moves, and the fine one at rest.
TEST_F(PlaneSetTest, AMovingSliceIsSampledQuickly) {
  std::set<SliceId> images;
  for (int i = 0; images.size() < 3; ++i) {
    const WantedPlane wanted = sliceAt(0.5 + 1e-6 * i, 2048);
    frame(wanted);
    const auto shown = planes_->shown(wanted);
    if (!shown) continue;
    images.insert(shown->image);
    EXPECT_EQ(widthOf(wanted), 301);
  }
  const WantedPlane at_rest = sliceAt(2.0, 2048);
  settle(at_rest);
  EXPECT_EQ(widthOf(at_rest), kSide);
  EXPECT_EQ(planes_->shown(at_rest)->plane, at_rest.plane);
}

TEST_F(PlaneSetTest, AFailureIsToldAndNotRepeated) {
  class FullRenderer : public NullRenderer {
    SliceId reserveSlice(int, int) override { throw NoGraphicsMemory("no room for a slice"); }
  } full;
  const WantedPlane wanted = sliceAt(1.0, 512);
  do {
    UploadAllowance allowance;
    planes_->update(full, {wanted}, allowance);
    std::this_thread::yield();
  } while (planes_->busy());
  EXPECT_EQ(planes_->error(), "no room for a slice");
  EXPECT_FALSE(planes_->shown(wanted));
  settle(sliceAt(2.0, 512));
  EXPECT_EQ(planes_->error(), "");
}

TEST(PlanesOfTest, APictureShowsAsManyValuesAsItHasPixels) {
  ViewVolume volume;
  volume.voxels = Index3(2048);
  ViewState state = firstView(volume, 1.5);
  state.slices[0].shown = true;
  const auto most = [&](double height) { return planesOf(state, volume, height)[0].most_values; };
  EXPECT_EQ(most(200.0), 512);
  EXPECT_GE(most(800.0), 800);
  EXPECT_LT(most(800.0), 2048);
  state.camera.distance /= 8.0;
  EXPECT_EQ(most(800.0), 2048);
  state.camera.orthographic = true;
  EXPECT_EQ(most(800.0), 2048);
}

}  // namespace
}  // namespace isobrick
