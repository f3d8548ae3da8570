// The view that a volume opens with: framed as it comes, whole unless that takes long.
#include "isobrick/viewer/session/opening_view.h"

#include <gtest/gtest.h>

namespace isobrick {
namespace {

class OpeningViewTest : public ::testing::Test {
 protected:
  OpeningViewTest() { volume_.voxels = {100, 80, 60}; }

  // The surface after a pass of this radius, drawn once in so many seconds.
  void see(double radius, double drawing = 0.01) {
    sight_.box = volume_.boxAround({20, 20, 20}, {40, 50, 30});
    sight_.radius = radius;
    opening_.update(sight_, volume_, 1.5, state_);
    opening_.noteDrawing(drawing);
    opening_.update(sight_, volume_, 1.5, state_);
  }

  ViewVolume volume_;
  ViewState state_ = firstView(volume_, 1.0);
  OpeningView opening_{state_};
  OpeningView::Sight sight_;
};

TEST_F(OpeningViewTest, AllOfTheSurfaceIsShownAndFramed) {
  opening_.update(sight_, volume_, 1.5, state_);  // nothing is there yet
  EXPECT_EQ(state_.camera.pivot, volume_.box().center());
  see(16.0);
  EXPECT_EQ(state_.camera.pivot, volume_.boxAround({20, 20, 20}, {40, 50, 30}).center());
  EXPECT_FALSE(opening_.isOver());
  sight_.is_whole = true;
  see(volume_.diagonal());
  EXPECT_TRUE(opening_.isOver());
  EXPECT_TRUE(state_.focus.everywhere);
  EXPECT_EQ(opening_.limit(state_), "");
  EXPECT_EQ(opening_.view(), state_);
}

TEST_F(OpeningViewTest, WhatTakesLongEndsTheGrowth) {
  sight_.extraction_seconds = 0.31;
  see(32.0);
  EXPECT_FALSE(state_.focus.everywhere);
  EXPECT_EQ(state_.focus.radius, 32.0);
  EXPECT_NE(opening_.limit(state_).find("takes long"), std::string::npos);
  // A user who wants it whole gets it.
  state_.focus.everywhere = true;
  see(32.0);
  EXPECT_TRUE(state_.focus.everywhere);
  EXPECT_EQ(opening_.limit(state_), "");
}

TEST_F(OpeningViewTest, SoDoesAPassThatDoesNotCome) {
  sight_.waited = 1.9;
  see(32.0);
  EXPECT_TRUE(state_.focus.everywhere);
  sight_.waited = 2.1;
  see(32.0);
  EXPECT_EQ(state_.focus.radius, 32.0);
  EXPECT_FALSE(state_.focus.everywhere);
}

// Nothing is shown: then a region of interest would show nothing either.
TEST_F(OpeningViewTest, TheFirstPassIsWaitedFor) {
  sight_.waited = 100.0;
  opening_.update(sight_, volume_, 1.5, state_);
  EXPECT_TRUE(state_.focus.everywhere);
}

TEST_F(OpeningViewTest, ASlowPictureCountsTheSecondTime) {
  see(64.0, 2.0);  // shaders were compiled
  EXPECT_TRUE(state_.focus.everywhere);
  see(64.0, 2.0);
  EXPECT_FALSE(state_.focus.everywhere);
  EXPECT_EQ(state_.focus.radius, 32.0);
  EXPECT_NE(opening_.limit(state_).find("drawn"), std::string::npos);
}

TEST_F(OpeningViewTest, AFullCardIsNamed) {
  sight_.over_budget = true;
  see(64.0);
  EXPECT_FALSE(state_.focus.everywhere);
  EXPECT_NE(opening_.limit(state_).find("card"), std::string::npos);
}

TEST_F(OpeningViewTest, TheUsersCameraAndFocusStay) {
  see(16.0);
  const ViewState first = opening_.view();
  state_.camera = orbited(state_.camera, 30.0, 0.0);
  state_.focus.everywhere = false;
  const ViewState users = state_;
  sight_.extraction_seconds = 1.0;
  see(32.0);
  EXPECT_EQ(state_, users);
  EXPECT_TRUE(opening_.isOver());
  EXPECT_EQ(opening_.view(), first);
}

// A preview, which is never whole, says nothing of the time that the volume takes.
TEST_F(OpeningViewTest, APreviewChoosesNoFocus) {
  sight_.is_preview = true;
  sight_.waited = 100.0;
  sight_.extraction_seconds = 1.0;
  see(16.0);
  see(16.0);
  EXPECT_TRUE(state_.focus.everywhere);
  OpeningView whole(state_);
  whole.follow(opening_);
  sight_.is_preview = false;
  whole.update(sight_, volume_, 1.5, state_);
  EXPECT_FALSE(state_.focus.everywhere);
  // What the user chose in it stays.
  state_ = whole.view();
  OpeningView users(state_);
  sight_.is_preview = true;
  state_.focus.radius = 3.0;
  users.update(sight_, volume_, 1.5, state_);
  OpeningView after(state_);
  after.follow(users);
  sight_.is_preview = false;
  after.update(sight_, volume_, 1.5, state_);
  EXPECT_EQ(state_.focus.radius, 3.0);
}

TEST_F(OpeningViewTest, WithoutASurfaceItIsOver) {
  sight_.box.reset();
  sight_.is_whole = true;
  opening_.update(sight_, volume_, 1.5, state_);
  EXPECT_TRUE(opening_.isOver());
  EXPECT_TRUE(state_.focus.everywhere);
}

}  // namespace
}  // namespace isobrick
