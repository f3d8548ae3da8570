// Previews while a volume is built, and the volume after them, in the order that a test wants.
#include <gtest/gtest.h>

#include <atomic>
#include <filesystem>
#include <glm/geometric.hpp>
#include <thread>

#include "isobrick/viewer/session/view_session.h"
#include "tests/support/field_pyramid.h"
#include "tests/support/keeping_renderer.h"
#include "tests/support/ply_reader.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

constexpr double kRadius = 50.0;  // world units

// A sphere, built on the opener's thread, which waits where the test wants it to.
class VolumeShowTest : public ::testing::Test {
 protected:
  VolumeShowTest() {
    geometry_.spacing = {0.75, 1.0, 1.25};
    geometry_.origin = {-300.0, 20.0, 5.0};
    center_ = geometry_.indexToWorld(0.5 * glm::dvec3(kVoxels - Index3(1)));
  }

  // After `hold_at_` previews it waits for `goes_on_`, or to be cancelled.
  std::string build(const BuildListener& listener, const CancelFlag& cancel) {
    BuildOptions options;
    options.with_curvature = false;
    options.cancel = &cancel;
    options.preview.folder = previews_.path();
    options.preview.most_share = 1.0;
    options.preview.published = [&](const BuildPreview& preview) {
      ++published_;
      listener.preview(preview.path, {preview.step, preview.voxels});
      EXPECT_FALSE(fs::exists(preview.path));  // nobody has to tidy up
      while (published_ >= hold_at_ && !goes_on_ && !cancel.requested()) std::this_thread::yield();
    };
    const std::string path = test::buildField(
        folder_, kVoxels,
        [&](const glm::dvec3& p) {
          return kRadius - glm::distance(geometry_.indexToWorld(p), center_);
        },
        options, geometry_, "sphere.isb");
    if (fails_) throw Error("the disk is full");
    return path;
  }

  // Frames of a window, until `done`.
  template <typename F>
  void framesUntil(F&& done) {
    do {
      if (auto preview = opener_.takePreview()) take(std::move(*preview));
      if (auto outcome = opener_.poll()) {
        ended_ = true;
        if (outcome->volume)
          take(std::move(*outcome->volume));
        else
          show_.giveUpPreview(renderer_, kSize);
      }
      UploadAllowance allowance;
      show_.update(clock_ += 0.05, allowance);
      if (show_.session() != nullptr) show_.session()->draw();
      if (show_.session() != nullptr) show_.session()->noteDrawing(0.001);
      std::this_thread::yield();
    } while (!done());
  }
  void take(OpenedVolume opened) { show_.take(std::move(opened), renderer_, kSize); }
  bool isWhole() const { return ended_ && show_.settled(); }

  // Of what is on the screen, in world units.
  double farthestFromSphere() const {
    const std::string path = folder_.file("shown.ply");
    show_.session()->writeShownMesh(path);
    const test::PlyMesh mesh = test::readPly(path);
    double farthest = mesh.positions.empty() ? 1e9 : 0.0;
    for (const glm::dvec3& position : mesh.positions)
      farthest = std::max(farthest, std::abs(glm::distance(position, center_) - kRadius));
    return farthest;
  }

  const Index3 kVoxels{160, 120, 130};
  const glm::dvec2 kSize{200.0, 100.0};
  GridGeometry geometry_;
  glm::dvec3 center_{0.0};
  test::TemporaryFolder folder_, previews_;
  std::atomic<int> published_{0}, hold_at_{1};
  std::atomic<bool> goes_on_{false}, fails_{false};
  bool ended_ = false;
  test::KeepingRenderer renderer_;
  double clock_ = 0.0;
  VolumeShow show_{SessionOptions{1, std::uint64_t{1} << 30}};
  VolumeOpener opener_{[this](const std::string&, const BuildListener& listener,
                              const CancelFlag& cancel) { return build(listener, cancel); },
                       std::uint64_t{64} << 20};
};

TEST_F(VolumeShowTest, APreviewIsShownBeforeTheBuildHasEnded) {
  opener_.open("scan");
  framesUntil([&] { return show_.showsPreview() && show_.settled(); });
  EXPECT_TRUE(opener_.status().busy);
  EXPECT_FALSE(fs::exists(folder_.file("sphere.isb")));
  EXPECT_EQ(show_.session()->status().limited, "preview at 1/2");
  EXPECT_EQ(renderer_.frame().first_level, 1);
  EXPECT_EQ(show_.session()->status().doing, "ready");
  EXPECT_EQ(show_.session()->volume().voxels, kVoxels);
  show_.session()->state().surfaces[0].isovalue = 0.0;
  show_.session()->keepFocus();
  framesUntil([&] { return show_.settled(); });
  EXPECT_LT(farthestFromSphere(), 0.25);  // of voxels of 1.5 to 2.5
  goes_on_ = true;
  framesUntil([&] { return isWhole(); });
  EXPECT_FALSE(show_.showsPreview());
  EXPECT_EQ(show_.session()->status().limited, "");
  EXPECT_EQ(renderer_.frame().first_level, 0);
  EXPECT_EQ(show_.opened()->pyramid, folder_.file("sphere.isb"));
  EXPECT_LT(farthestFromSphere(), 0.05);
  EXPECT_TRUE(fs::is_empty(previews_.path()));
}

// The view that the user changed stays; whatever follows from the values comes from all of them.
TEST_F(VolumeShowTest, TheViewOutlivesThePreview) {
  hold_at_ = 2;
  opener_.open("scan");
  framesUntil([&] { return published_ == 2 && show_.showsPreview() && show_.settled(); });
  const double of_preview = show_.session()->state().surfaces[0].isovalue;
  ViewState& state = show_.session()->state();
  state.focus.center = {40.0, 50.0, 60.0};
  state.focus.radius = 21.0;
  state.camera.azimuth = 77.0;
  state.camera.distance = 123.0;
  state.clip_planes.push_back({{0.0, 0.0, 1.0}, 40.0});
  state.slices[1] = {true, 33.0};
  show_.session()->interaction().show_help = true;
  framesUntil([&] { return show_.settled(); });
  const ViewState before = show_.session()->state();
  EXPECT_EQ(before.focus.center, glm::dvec3(40.0, 50.0, 60.0));
  goes_on_ = true;
  framesUntil([&] { return isWhole(); });
  ViewState after = show_.session()->state();
  EXPECT_EQ(after.surfaces[0].isovalue, show_.session()->volume().isovalues.front());
  EXPECT_NE(after.surfaces[0].isovalue, of_preview);
  EXPECT_EQ(after.value_window[1], show_.session()->volume().greatest_value);
  EXPECT_TRUE(show_.session()->interaction().show_help);
  after.surfaces = before.surfaces;
  after.value_window = before.value_window;
  EXPECT_EQ(after, before);
}

// Also where the preview has no such value, and while a button is down.
TEST_F(VolumeShowTest, AnIsovalueOfHandsStays) {
  opener_.open("scan");
  framesUntil([&] { return show_.showsPreview() && show_.settled(); });
  show_.session()->state().surfaces[0].isovalue = 49.0;
  ASSERT_LT(show_.session()->volume().greatest_value, 49.0);
  framesUntil([&] { return show_.settled(); });
  goes_on_ = true;
  framesUntil([&] { return isWhole(); });
  EXPECT_EQ(show_.session()->state().surfaces[0].isovalue, 49.0);
}

TEST_F(VolumeShowTest, WhatWasShownBeforeComesBackWhereABuildEndsWithout) {
  const std::string other = test::buildField(
      folder_, Index3(20), [](const glm::dvec3& p) { return p.x; }, {}, {}, "other.isb");
  take(openPyramid(other, std::uint64_t{16} << 20));
  show_.session()->state().focus.radius = 5.0;
  framesUntil([&] { return show_.settled(); });
  const ViewState before = show_.session()->state();
  opener_.open("scan");
  framesUntil([&] { return show_.showsPreview() && show_.settled(); });
  EXPECT_EQ(show_.session()->volume().voxels, kVoxels);
  opener_.cancel();  // as 'stop' does
  show_.giveUpPreview(renderer_, kSize);
  framesUntil([&] { return show_.settled() && !opener_.status().busy; });
  EXPECT_EQ(show_.opened()->pyramid, other);
  EXPECT_EQ(show_.session()->state(), before);
  EXPECT_TRUE(fs::is_empty(previews_.path()));
  // The same for one that fails.
  goes_on_ = fails_ = true;
  opener_.open("scan");
  framesUntil([&] { return ended_ && show_.settled(); });
  EXPECT_EQ(show_.session()->state(), before);
}

TEST_F(VolumeShowTest, NothingIsLeftWhereNothingWasShownBefore) {
  opener_.open("scan");
  framesUntil([&] { return show_.showsPreview() && show_.settled(); });
  opener_.cancel();
  show_.giveUpPreview(renderer_, kSize);
  EXPECT_EQ(show_.session(), nullptr);
  EXPECT_TRUE(renderer_.kept().empty());
  while (opener_.status().busy) std::this_thread::yield();
  EXPECT_FALSE(opener_.takePreview());
  EXPECT_TRUE(fs::is_empty(previews_.path()));
}

// A driver that is reset while both are there.
TEST_F(VolumeShowTest, BothOutliveTheirRenderer) {
  opener_.open("scan");
  framesUntil([&] { return show_.showsPreview() && show_.settled(); });
  show_.session()->interaction().playing = true;  // without steps of time
  goes_on_ = true;
  framesUntil([&] { return ended_; });
  show_.suspend();
  EXPECT_TRUE(renderer_.kept().empty());
  show_.resume(renderer_);
  framesUntil([&] { return isWhole(); });
  EXPECT_FALSE(show_.showsPreview());
  EXPECT_EQ(show_.session()->state().step, 0);
  EXPECT_FALSE(renderer_.frame().chunks.empty());
}

// The next one is made while one is shown: there is never a frame without a surface.
TEST_F(VolumeShowTest, AStepOfTimeFollowsAnotherWithItsView) {
  const auto step = [&](int number, double radius, const char* name) {
    OpenedVolume opened = openPyramid(
        test::buildField(
            folder_, Index3(40),
            [=](const glm::dvec3& p) { return radius - glm::distance(p, glm::dvec3(19.5)); }, {},
            {}, name),
        std::uint64_t{64} << 20);
    opened.step = number;
    return opened;
  };
  take(step(0, 12.0, "0.isb"));
  framesUntil([&] { return show_.settled(); });
  ViewState& state = show_.session()->state();
  state.surfaces[0].isovalue = 1.0;
  state.camera.azimuth = 77.0;
  framesUntil([&] { return show_.settled(); });
  const std::uint64_t before = show_.session()->status().triangles;
  EXPECT_GT(before, 0u);
  show_.session()->interaction().playing = true;
  take(step(1, 8.0, "1.isb"));
  framesUntil([&] {
    EXPECT_FALSE(renderer_.frame().chunks.empty());
    return show_.settled();
  });
  EXPECT_EQ(show_.opened()->step, 1);
  EXPECT_EQ(show_.session()->state().step, 1);
  EXPECT_EQ(show_.session()->state().camera.azimuth, 77.0);
  EXPECT_EQ(show_.session()->state().surfaces[0].isovalue, 1.0);
  EXPECT_LT(show_.session()->status().triangles, before);
  // An isovalue that no voxel of a step has stays that of all.
  const double since = clock_;
  take(step(2, 0.5, "2.isb"));
  framesUntil([&] { return show_.settled(); });
  EXPECT_GE(clock_, since + VolumeShow::kStepSeconds - 0.051);
  EXPECT_EQ(show_.session()->status().triangles, 0u);
  EXPECT_EQ(show_.session()->state().surfaces[0].isovalue, 1.0);
}

}  // namespace
}  // namespace isobrick
