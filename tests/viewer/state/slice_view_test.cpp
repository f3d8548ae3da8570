#include "isobrick/viewer/state/slice_view.h"

#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <random>
#include <string>

namespace isobrick {
namespace {

ViewVolume boxVolume() {
  ViewVolume volume;
  volume.voxels = {101, 51, 21};
  volume.geometry.spacing = {1.0, 2.0, 5.0};  // 100 in each direction
  volume.least_value = -1000.0;
  volume.greatest_value = 3000.0;
  return volume;
}

ViewState stateOf(const ViewVolume& volume) {
  ViewState state = firstView(volume, 1.0);
  state.slice_views.shown = true;
  return state;
}

glm::dvec3 worldStep(const ViewVolume& volume, const glm::dvec3& index_step) {
  return volume.geometry.indexToWorldMatrix() * index_step;
}

// Right and down of the three views in the world, whatever way its voxels lie.
TEST(SliceFrameTest, LooksAsARadiologistDoesWhateverWayTheVoxelsLie) {
  const glm::dvec3 x(1, 0, 0), y(0, 1, 0), z(0, 0, 1);
  const glm::dmat3 directions[] = {{x, y, z},
                                   {-x, -y, z},
                                   {z, x, y},
                                   {y, -z, x},
                                   {glm::normalize(x + 0.3 * y), glm::normalize(y - 0.3 * x), -z}};
  for (const glm::dmat3& direction : directions) {
    ViewVolume volume = boxVolume();
    volume.geometry.direction = direction;
    const ViewState state = stateOf(volume);
    const glm::dvec3 right[] = {y, x, x}, down[] = {-z, -z, y};
    for (int view = 0; view < kSliceViews; ++view) {
      const SliceFrame frame = sliceFrame(state, volume, view, {300.0, 200.0});
      const glm::dvec3 shown_right = worldStep(volume, frame.right);
      const glm::dvec3 shown_down = worldStep(volume, frame.down);
      EXPECT_GT(glm::dot(glm::normalize(shown_right), right[view]), 0.9) << view;
      EXPECT_GT(glm::dot(glm::normalize(shown_down), down[view]), 0.9) << view;
      // Pixels are square.
      EXPECT_NEAR(glm::length(shown_right), glm::length(shown_down), 1e-9);
      EXPECT_EQ(frame.right[frame.axis], 0.0);
      EXPECT_EQ(frame.down[frame.axis], 0.0);
    }
  }
  const ViewVolume volume = boxVolume();
  const SliceFrame axial = sliceFrame(stateOf(volume), volume, 2, {300.0, 200.0});
  EXPECT_EQ(axial.axis, 2);
  EXPECT_EQ(std::string(axial.sides[0]) + axial.sides[1] + axial.sides[2] + axial.sides[3],
            "-x+x-y+y");
  const SliceFrame coronal = sliceFrame(stateOf(volume), volume, 1, {300.0, 200.0});
  EXPECT_EQ(std::string(coronal.sides[2]) + coronal.sides[3], "+z-z");
}

TEST(SliceFrameTest, ShowsAllOfTheSliceInTheMiddle) {
  const ViewVolume volume = boxVolume();
  ViewState state = stateOf(volume);
  state.slices[2].position = 7.0;
  const SliceFrame frame = sliceFrame(state, volume, 2, {300.0, 200.0});
  const glm::dvec2 first = frame.pixelOf({0.0, 0.0, 7.0}), last = frame.pixelOf({100.0, 50.0, 7.0});
  EXPECT_NEAR(first.y, 200.0 - last.y, 1e-9);
  EXPECT_NEAR(first.x, 300.0 - last.x, 1e-9);
  EXPECT_GT(first.y, 0.0);
  EXPECT_GT(last.y - first.y, 185.0);
  EXPECT_EQ(frame.indexAt({0.0, 0.0}).z, 7.0);
}

TEST(SliceFrameTest, ZoomKeepsThePlaceUnderTheCursorAndADragMovesItAlong) {
  const ViewVolume volume = boxVolume();
  std::mt19937 random(5);
  std::uniform_real_distribution<double> share(0.2, 0.8);
  for (int round = 0; round < 200; ++round) {
    ViewState state = stateOf(volume);
    const glm::dvec2 size(400.0, 300.0);
    const int view = round % 3;
    const glm::dvec2 a = size * glm::dvec2(share(random), share(random));
    const glm::dvec2 b = size * glm::dvec2(share(random), share(random));
    const SliceFrame before = sliceFrame(state, volume, view, size);
    const glm::dvec3 place = before.indexAt(a);
    zoomSlices(before, a, 1.0 + 3.0 * share(random), state);
    const SliceFrame near = sliceFrame(state, volume, view, size);
    EXPECT_NEAR(glm::distance(near.pixelOf(place), a), 0.0, 1e-6);
    moveSlices(near, a, b, state);
    const SliceFrame moved = sliceFrame(state, volume, view, size);
    EXPECT_NEAR(glm::distance(moved.pixelOf(place), b), 0.0, 1e-6);
    EXPECT_EQ(moved.axis, view);
    // Along its axis all views stay where they were.
    EXPECT_EQ(moved.center[view], before.center[view]);
  }
}

TEST(SliceFrameTest, ThePlaceWhereSlicesCrossAndTheirSteps) {
  const ViewVolume volume = boxVolume();
  ViewState state = stateOf(volume);
  const SliceFrame axial = sliceFrame(state, volume, 2, {300.0, 200.0});
  const double z = state.slices[2].position;
  crossAt(axial, {12.4, 33.6, 5.0}, state);
  EXPECT_EQ(state.slices[0].position, 12.0);
  EXPECT_EQ(state.slices[1].position, 34.0);
  EXPECT_EQ(state.slices[2].position, z);
  stepSlice(axial, 3.0, state);
  EXPECT_EQ(state.slices[2].position, z + 3.0);
  stepSlice(axial, 1e6, state);
  EXPECT_EQ(bounded(state, volume).slices[2].position, 20.0);
}

TEST(SliceFrameTest, TheWindowWidensToTheRightAndBrightensUpwards) {
  const ViewVolume volume = boxVolume();
  ViewState state = stateOf(volume);
  state.value_window = {0.0, 1000.0};
  dragWindow({100.0, 0.0}, volume, state);  // a quarter of all values
  EXPECT_NEAR(state.value_window[1] - state.value_window[0], 2000.0, 1e-9);
  EXPECT_NEAR(state.value_window[1] + state.value_window[0], 1000.0, 1e-9);
  dragWindow({0.0, -40.0}, volume, state);
  EXPECT_NEAR(state.value_window[1] + state.value_window[0], 200.0, 1e-9);
  dragWindow({-1e9, 0.0}, volume, state);
  EXPECT_GT(state.value_window[1], state.value_window[0]);
}

TEST(SliceFrameTest, AFileWithAWindowOfNoPixelsOrAZoomOfNothingIsBounded) {
  const ViewVolume volume = boxVolume();
  ViewState state = stateOf(volume);
  state.slice_views.zoom = 1e30;
  state.slice_views.center = glm::dvec3(-1e9, 1e9, 3.0);
  state = bounded(state, volume);
  EXPECT_EQ(state.slice_views.zoom, kMostSliceZoom);
  EXPECT_EQ(*state.slice_views.center, glm::dvec3(0.0, 50.0, 3.0));
  const SliceFrame frame = sliceFrame(state, volume, 1, {0.0, 0.0});
  EXPECT_TRUE(std::isfinite(frame.corner.x) && std::isfinite(frame.right.x));
}

}  // namespace
}  // namespace isobrick
