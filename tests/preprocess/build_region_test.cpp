// A super-brick's build reads and passes on what the whole pyramid's does there, and little
// more than itself.
#include <gtest/gtest.h>

#include "isobrick/preprocess/build_plan.h"
#include "isobrick/preprocess/kernels/low_pass.h"
#include "isobrick/storage/index_loop.h"
#include "tests/support/random_numbers.h"

namespace isobrick::test {
namespace {

bool holds(const IndexBox& outer, const IndexBox& inner) {
  return inner.size() == 0 || (intersectionOf(outer, inner) == inner);
}

void expectEnough(const PyramidSpec& spec, const BuildRegion& region) {
  const BrickNeeds needs(spec);
  const Lattice lattice(spec.voxels);
  for (int level = region.firstLevel(); level < region.endLevel(); ++level) {
    const IndexBox& own = region.rows().bricks(level);
    const IndexBox all = region.samples(level, region.windowBricks(level));
    EXPECT_TRUE(holds(region.windowBricks(level), own));
    EXPECT_TRUE(holds(all, needs.samples(level, own)));
    // The level below passes on all that the windows of this one take.
    if (level > region.firstLevel()) {
      EXPECT_TRUE(holds(region.passedSamples(level - 1), all));
    }
    // Each passed sample comes from one brick, which reads enough for it.
    std::int64_t passed = 0;
    forEachIndex(region.windowBricks(level), [&](const Index3& brick) {
      const IndexBox one = region.handedOn(level, {brick, Index3(1)});
      passed += one.size();
      EXPECT_TRUE(holds(all, region.samples(level, {brick, Index3(1)})));
      if (one.size() > 0) {
        EXPECT_TRUE(holds(region.samples(level, {brick, Index3(1)}),
                          lowPassSupport(lattice, level, spec.filter, one)));
      }
    });
    EXPECT_EQ(passed, region.passedSamples(level).size());
  }
}

TEST(BuildRegion, SuperBricksReadAndPassOnWhatTheyNeed) {
  Random random(3);
  for (int round = 0; round < 60; ++round) {
    PyramidSpec spec;
    for (int axis = 0; axis < 3; ++axis) spec.voxels[axis] = randomInt(random, 6, 150);
    spec.brick_cells = std::int64_t{4} << randomInt(random, 0, 2);
    spec.tile_cells = std::int64_t{2} << randomInt(random, 0, 1);
    spec.filter = round % 4 == 0 ? format::Filter::kSubsample : format::Filter::kAverage;
    const BrickLayout layout = spec.layout();
    SCOPED_TRACE("round " + std::to_string(round));
    expectEnough(spec, BuildRegion(spec));
    const SuperBricks super_bricks(layout, spec.brick_cells << randomInt(random, 0, 3));
    expectEnough(spec, BuildRegion(spec, DividedFile{super_bricks, std::nullopt}));
    std::size_t bricks = super_bricks.rowsOfIndex().count();
    for (std::size_t number = 0; number < super_bricks.count(); ++number) {
      const BuildRegion region(spec, DividedFile{super_bricks, number});
      expectEnough(spec, region);
      bricks += region.rows().count();
      for (int level = 0; level < region.endLevel(); ++level)
        forEachIndex(region.rows().bricks(level), [&](const Index3& brick) {
          EXPECT_EQ(super_bricks.numberOf(level, brick), number);
          const auto [there, same] = region.rows().address(region.rows().row(level, brick));
          EXPECT_TRUE(there == level && same == brick);
        });
    }
    // Every brick is in one file.
    EXPECT_EQ(bricks, TableRows(layout).count());
  }
}

TEST(BuildRegion, ASuperBrickReadsATenthMoreThanItself) {
  PyramidSpec spec;
  spec.voxels = Index3(3 * 2048 + 1);
  const SuperBricks super_bricks(spec.layout(), 2048);
  ASSERT_EQ(super_bricks.levels(), 4);
  const BuildRegion middle(spec, DividedFile{super_bricks, 13});
  const auto read = static_cast<double>(middle.samples(0, middle.windowBricks(0)).size());
  EXPECT_LT(read, 1.1 * 2048 * 2048 * 2048);
  std::int64_t sum = 0;
  for (std::size_t number = 0; number < super_bricks.count(); ++number) {
    const BuildRegion region(spec, DividedFile{super_bricks, number});
    sum += region.samples(0, region.windowBricks(0)).size();
  }
  EXPECT_LT(static_cast<double>(sum), 1.07 * static_cast<double>(elementCount(spec.voxels)));
}

}  // namespace
}  // namespace isobrick::test
