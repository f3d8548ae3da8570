#include "isobrick/preprocess/sources/one_grid.h"

#include <cmath>
#include <glm/geometric.hpp>

#include "isobrick/storage/error.h"
#include "tests/support/volume_files.h"

namespace isobrick {
namespace {

using test::errorOf;

// Turned about two axes, with steps of three lengths.
glm::dmat3 obliqueSteps() {
  const double c = std::cos(0.3), s = std::sin(0.3), d = std::cos(1.1), t = std::sin(1.1);
  const glm::dmat3 turn =
      glm::dmat3({c, s, 0}, {-s, c, 0}, {0, 0, 1}) * glm::dmat3({1, 0, 0}, {0, d, t}, {0, -t, d});
  return {turn[0] * 0.4, turn[1] * 0.7, turn[2] * 3.1};
}

constexpr Index3 kVoxels{100, 80, 30};

GridGeometry gridOf(const StatedPlaces& stated, const Index3& voxels = kVoxels) {
  std::vector<std::string> notes;
  return oneGrid("scan", stated, voxels, notes);
}

double distance(const glm::dmat3& a, const glm::dmat3& b) {
  return glm::length(a[0] - b[0]) + glm::length(a[1] - b[1]) + glm::length(a[2] - b[2]);
}

TEST(OneGrid, KeepsTheExactBitsOfAxesAtRightAngles) {
  const GridGeometry grid = gridOf({glm::dmat3({0, -0.65, 0}, {0.1, 0, 0}, {0, 0, -3}), {1, 2, 3}});
  EXPECT_EQ(grid.spacing, glm::dvec3(0.65, 0.1, 3));
  EXPECT_EQ(grid.origin, glm::dvec3(1, 2, 3));
  EXPECT_EQ(grid.direction, glm::dmat3({0, -1, 0}, {1, 0, 0}, {0, 0, -1}));
}

TEST(OneGrid, KeepsObliqueStepsOfEitherHandedness) {
  glm::dmat3 steps = obliqueSteps();
  for (int flipped = 0; flipped < 2; ++flipped) {
    std::vector<std::string> notes;
    const GridGeometry grid = oneGrid("scan", {steps, {5, -6, 7}}, kVoxels, notes);
    EXPECT_LT(distance(grid.indexToWorldMatrix(), steps), 1e-12);
    EXPECT_LT(distance(grid.direction * glm::transpose(grid.direction), glm::dmat3(1)), 1e-12);
    EXPECT_TRUE(notes.empty());
    steps[1] = -steps[1];
  }
}

// A shear is as harmless as the volume is small: the rule is about voxels, not about angles.
TEST(OneGrid, RefusesAShearByHowFarItMovesVoxels) {
  glm::dmat3 steps(1.0);
  steps[1].x = 1e-4;
  std::vector<std::string> notes;
  const GridGeometry grid = oneGrid("scan", {steps, glm::dvec3(0)}, Index3(100), notes);
  EXPECT_EQ(grid.origin, glm::dvec3(0));
  EXPECT_LT(distance(grid.direction * glm::transpose(grid.direction), glm::dmat3(1)), 1e-12);
  // The turn shares the shear between both axes.
  EXPECT_NEAR(grid.direction[1].x, 0.5e-4, 1e-6);
  ASSERT_EQ(notes.size(), 1u);
  EXPECT_CONTAINS(notes.front(), "not at right angles but up to 0.0057");

  const std::string error = errorOf([&] { gridOf({steps, glm::dvec3(0)}, Index3(1000)); });
  EXPECT_CONTAINS(error, "cannot use 'scan'");
  EXPECT_CONTAINS(error, "right angles");
  EXPECT_CONTAINS(error, "up to 0.035");  // half of half of 0.0999 along two axes
}

// The steps need not be along the world's axes, and every corner of the result is near its place.
TEST(OneGrid, PutsEveryCornerWithinAHundredthOfAVoxel) {
  glm::dmat3 steps = obliqueSteps();
  steps[2] += steps[0] * 4e-4 - steps[1] * 3e-4;
  const StatedPlaces stated{steps, {5, -6, 7}};
  const GridGeometry grid = gridOf(stated);
  for (const double i : {0.0, 99.0})
    for (const double j : {0.0, 79.0})
      for (const double k : {0.0, 29.0}) {
        const glm::dvec3 index(i, j, k);
        EXPECT_LT(glm::length(grid.worldToIndex(stated.origin + steps * index) - index), 0.01);
      }
}

TEST(OneGrid, RefusesSlicesThatLieBesideTheLineOrUnevenly) {
  StatedPlaces stated{obliqueSteps(), glm::dvec3(0)};
  for (int k = 0; k < 30; ++k) stated.slices.push_back(stated.steps[2] * double(k));
  stated.steps[2] = glm::dvec3(0);  // slices say it
  std::vector<std::string> notes;
  const GridGeometry grid = oneGrid("scan", stated, kVoxels, notes);
  EXPECT_LT(distance(grid.indexToWorldMatrix(), obliqueSteps()), 1e-12);
  EXPECT_TRUE(notes.empty());
  for (const int axis : {0, 1, 2}) {
    StatedPlaces moved = stated;
    moved.slices[7] += obliqueSteps()[axis] * 0.005;
    notes.clear();
    oneGrid("scan", moved, kVoxels, notes);
    ASSERT_EQ(notes.size(), 1u);
    EXPECT_CONTAINS(notes.front(), "slices are not at even places");
    moved.slices[7] += obliqueSteps()[axis] * 0.245;
    const std::string error = errorOf([&] { gridOf(moved); });
    EXPECT_CONTAINS(error, "slices are not at even places");
    EXPECT_CONTAINS(error, "up to 0.25 of a voxel");
  }
  // A tilted gantry: even places on a line that is not at right angles to the slices.
  StatedPlaces tilted = stated;
  for (int k = 0; k < 30; ++k) tilted.slices[k] += stated.steps[1] * (0.1 * k);
  EXPECT_CONTAINS(errorOf([&] { gridOf(tilted); }), "right angles");
}

TEST(OneGrid, RefusesStepsThatSpanNoSpace) {
  const auto error = [](const glm::dmat3& steps) {
    return errorOf([&] { gridOf({steps, glm::dvec3(0)}); });
  };
  EXPECT_CONTAINS(error(glm::dmat3({1, 0, 0}, {1, 0, 0}, {0, 0, 1})), "in one plane");
  EXPECT_CONTAINS(error(glm::dmat3({1, 0, 0}, {0, 0, 0}, {0, 0, 1})), "axis 1");
  EXPECT_CONTAINS(error(glm::dmat3({1, 0, 0}, {0, NAN, 0}, {0, 0, 1})), "not a number");
}

}  // namespace
}  // namespace isobrick
