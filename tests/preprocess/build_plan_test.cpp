// Windows fit their buffers, and the buffers are no larger than the greatest window.
#include "isobrick/preprocess/build_plan.h"

#include <gtest/gtest.h>

#include "isobrick/preprocess/brick_window.h"
#include "isobrick/storage/error.h"
#include "tests/support/array_source.h"
#include "tests/support/random_numbers.h"

namespace isobrick::test {
namespace {

std::uint64_t bytesOf(const IndexBox& box, const PyramidSpec& spec) {
  return static_cast<std::uint64_t>(box.size()) * voxelBytes(spec.voxel_type);
}

// The greatest windows of a plan, found by looking at every one.
struct Greatest {
  std::uint64_t window_bytes = 0, handed_on_bytes = 0;
  std::int64_t slices = 0;  // of level 0
};

Greatest greatestWindows(const PyramidSpec& spec, const BuildPlan& plan) {
  const BrickNeeds needs(spec);
  const int levels = needs.layout().lattice().levels();
  Greatest greatest;
  for (int level = 0; level < levels; ++level) {
    const BuildPlan::WindowShape& shape = plan.windows[static_cast<std::size_t>(level)];
    const BrickWindows windows({Index3(0), needs.layout().bricks(level)}, shape.x, shape.y);
    for (std::int64_t i = 0; i < windows.count(); ++i) {
      const IndexBox bricks = windows.window(i), samples = needs.samples(level, bricks);
      greatest.window_bytes = std::max(greatest.window_bytes, bytesOf(samples, spec));
      if (level == 0) greatest.slices = std::max(greatest.slices, samples.count.z);
      if (level + 1 < levels)
        greatest.handed_on_bytes =
            std::max(greatest.handed_on_bytes, bytesOf(needs.handedOn(level, bricks), spec));
    }
  }
  return greatest;
}

TEST(BuildPlan, BuffersAreAsLargeAsTheGreatestWindow) {
  Random random(5);
  int windows_of_several_shapes = 0;
  for (int round = 0; round < 400; ++round) {
    PyramidSpec spec;
    spec.brick_cells = std::int64_t{4} << randomBelow(random, 4);
    do spec.tile_cells = std::int64_t{2} << randomBelow(random, 5);
    while (spec.tile_cells > spec.brick_cells);
    spec.filter = round % 2 == 0 ? format::Filter::kAverage : format::Filter::kSubsample;
    spec.voxel_type = round % 3 == 0 ? VoxelType::kFloat32 : VoxelType::kUint8;
    for (int axis = 0; axis < 3; ++axis) {
      // Most sizes are next to a multiple of a brick or of a power of two.
      const auto bricks = static_cast<std::int64_t>(1 + randomBelow(random, 9));
      const auto more = static_cast<std::int64_t>(randomBelow(random, 6)) - 2;
      spec.voxels[axis] =
          std::max<std::int64_t>(2, std::min<std::int64_t>(bricks * spec.brick_cells, 150) + more);
    }
    ArraySource<std::uint8_t> source(spec.voxels, {});
    const std::uint64_t memory = (std::uint64_t{8} << 20) + randomBelow(random, 1 << 21);
    BuildPlan plan;
    try {
      plan = makeBuildPlan(spec, BuildRegion(spec), &source, memory, 1);
    } catch (const Error&) {
      plan = makeBuildPlan(spec, BuildRegion(spec), &source, std::uint64_t{1} << 30, 1);
    }
    const Greatest greatest = greatestWindows(spec, plan);
    ASSERT_EQ(plan.window_bytes, greatest.window_bytes)
        << spec.voxels.x << " " << spec.voxels.y << " " << spec.voxels.z << " brick "
        << spec.brick_cells << " tile " << spec.tile_cells << " round " << round;
    ASSERT_EQ(plan.handed_on_bytes, greatest.handed_on_bytes) << round;
    ASSERT_GE(plan.spool_slices, greatest.slices) << round;
    windows_of_several_shapes += plan.windows[0].x > 1;
  }
  EXPECT_GT(windows_of_several_shapes, 20);
}

// The threads wait for each other at the end of a window, so it has bricks for all of them, as far
// as the memory goes.
TEST(BuildPlan, WindowsHaveBricksForAllThreads) {
  PyramidSpec spec;
  spec.voxels = Index3(512);
  spec.voxel_type = VoxelType::kUint16;
  ArraySource<std::uint16_t> source(spec.voxels, {});
  const auto bricksFor = [&](std::uint64_t memory, int threads) {
    const auto plan = makeBuildPlan(spec, BuildRegion(spec), &source, memory, threads);
    return plan.windows[0].x * plan.windows[0].y;
  };
  constexpr std::uint64_t kGibibyte = std::uint64_t{1} << 30;
  EXPECT_EQ(bricksFor(kGibibyte, 2), 8);
  EXPECT_EQ(bricksFor(kGibibyte, 8), 16);
  EXPECT_EQ(bricksFor(kGibibyte, 16), 32);
  EXPECT_LE(bricksFor(kGibibyte / 8, 16), 16);
}

TEST(BuildPlan, ABufferRefusesMoreThanItHolds) {
  const LargeBuffer buffer(100);
  EXPECT_EQ(buffer.dataFor(100), buffer.data());
  EXPECT_THROW(buffer.dataFor(101), std::logic_error);
}

}  // namespace
}  // namespace isobrick::test
