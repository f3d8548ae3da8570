// Which bricks a query around a focus reads.
#include <gtest/gtest.h>

#include <algorithm>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/vertex_numbering.h"
#include "isobrick/preprocess/phantoms/phantom.h"
#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/pyramid_parts.h"
#include "tests/support/field_pyramid.h"
#include "tests/support/random_numbers.h"

namespace isobrick::test {
namespace {

// Calls f(level, brick) for the bricks whose stored samples were read.
template <typename F>
void forEachBrickRead(const Pyramid& pyramid, F&& f) {
  for (int level = 0; level < pyramid.lattice().levels(); ++level)
    forEachIndex({Index3(0), pyramid.layout().bricks(level)}, [&](const Index3& brick) {
      const BrickRow row = pyramid.parts().brickRowOf(level, brick);
      if (row.part(PartKind::kSamples).stored_bytes > 0 &&
          pyramid.parts().holdIfResident(PartKind::kSamples, level, brick))
        f(level, brick);
    });
}

ExtractionReport extractAround(const Pyramid& pyramid, double isovalue, const glm::dvec3& focus,
                               double radius) {
  Query query;
  query.isovalue = isovalue;
  query.focus = FocusSphere{focus, radius};
  CountingSink sink;
  return extractIsosurface(pyramid, query, sink);
}

// Neither for itself nor, but where a crossing on its border hangs on it, for a coarser brick.
TEST(BricksRead, HardlyAnyIsReadOfWhichTheSurfaceCrossesNoTile) {
  const TemporaryFolder folder;
  BuildOptions options;
  options.brick_cells = 16;
  buildPyramid(*makePhantomSource(PhantomSpec{"head", 96, {}, 16}), folder.file("head.isb"),
               options);
  Random random(7);
  int read = 0, not_crossed = 0;
  for (int n = 0; n < 40; ++n) {
    const Pyramid pyramid(folder.file("head.isb"));
    const auto isovalue = static_cast<float>(randomReal(random, 200, 1500));
    const glm::dvec3 focus(randomReal(random, 0, 95), randomReal(random, 0, 95),
                           randomReal(random, 0, 95));
    extractAround(pyramid, isovalue, focus, randomReal(random, 2, 40));
    forEachBrickRead(pyramid, [&](int level, const Index3& brick) {
      std::vector<std::uint8_t> crossed;
      pyramid.parts().crossedTiles(level, brick, isovalue, crossed);
      ++read;
      if (std::find(crossed.begin(), crossed.end(), 1) == crossed.end()) ++not_crossed;
    });
  }
  EXPECT_GT(read, 1000);
  EXPECT_LT(not_crossed, read / 100) << read;
}

// Samples on the border that coarser leaves take are in the brick that has leaves there.
TEST(BricksRead, NoneIsReadBeyondABorderWhereTheSphereEnds) {
  const TemporaryFolder folder;
  BuildOptions options;
  options.brick_cells = 16;
  const std::string path = buildField(
      folder, Index3(65), [](const glm::dvec3& p) { return p.x + 0.1 * p.y; }, options);
  for (const double end : {16.0, 32.0, 48.0})
    for (const double side : {-1.0, 1.0}) {
      const Pyramid pyramid(path);
      const ExtractionReport report = extractAround(pyramid, 22.3, {20, 24, end + side * 7.5}, 4.0);
      ASSERT_EQ(report.levels.front().level, 0);
      const auto isBeyond = [&](const Index3& brick) {
        return side * (16.0 * static_cast<double>(brick.z) + 8 - end) < 0;
      };
      forEachBrickRead(pyramid, [&](int level, const Index3& brick) {
        EXPECT_FALSE(level == 0 && isBeyond(brick)) << end << " " << side << " " << brick.z;
      });
    }
}

}  // namespace
}  // namespace isobrick::test
