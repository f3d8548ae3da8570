// The kernels of uniform bricks against plain twins, bit by bit, on every instruction set of the
// machine.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <tuple>

#include "isobrick/extract/kernels/brick_crossings.h"
#include "isobrick/extract/kernels/brick_triangles.h"
#include "isobrick/extract/kernels/marching_cubes_table.h"
#include "tests/support/every_target.h"
#include "tests/support/random_numbers.h"

namespace isobrick::test {
namespace {

template <typename T>
class BrickKernels : public testing::Test {};
using VoxelTypes = testing::Types<std::uint8_t, std::int8_t, std::uint16_t, std::int16_t, float>;
TYPED_TEST_SUITE(BrickKernels, VoxelTypes);

// A random brick of a random volume, in memory that ends with its samples.
template <typename T>
struct RandomBrick {
  Lattice lattice;
  int level = 0;
  IndexBox cells, samples;
  std::vector<T> values;
  BrickGrid<T> grid;
  CornerSpacing spacing;
  WorldFrame frame{GridGeometry{}};
  float isovalue = 0;

  explicit RandomBrick(Random& random) {
    const std::int64_t brick_cells = std::int64_t{4} << randomInt(random, 0, 6);
    Index3 voxels;
    for (int axis = 0; axis < 3; ++axis)
      voxels[axis] = randomInt(random, 2, randomInt(random, 0, 2) == 0 ? 20 : 9);
    voxels[static_cast<int>(randomInt(random, 0, 2))] =
        randomInt(random, 2, randomInt(random, 0, 1) == 0 ? 600 : 70);
    lattice = Lattice(voxels);
    level = static_cast<int>(randomInt(random, 0, std::min(lattice.levels() - 1, 3)));
    const BrickLayout layout(lattice, brick_cells, 2);
    Index3 brick;
    for (int axis = 0; axis < 3; ++axis)
      brick[axis] = randomInt(random, 0, layout.bricks(level)[axis] - 1);
    cells = layout.brickCellBox(level, brick);
    samples = layout.brickSampleBox(level, brick);
    const bool smooth = randomInt(random, 0, 2) > 0;
    const std::int64_t steps = randomInt(random, 2, 100);
    for (std::int64_t n = 0; n < samples.size(); ++n) {
      const auto noise = static_cast<double>(randomInt(random, 0, steps));
      const double wave = 50 + 50 * std::sin(0.07 * static_cast<double>(n % samples.count.x) +
                                             0.3 * static_cast<double>(n / samples.count.x));
      const double value = smooth ? wave + 0.05 * noise : noise;
      values.push_back(static_cast<T>(std::is_signed_v<T> ? value - 50 : value));
    }
    isovalue = static_cast<float>(values[static_cast<std::size_t>(
        randomInt(random, 0, static_cast<std::int64_t>(values.size()) - 1))]);
    if (randomInt(random, 0, 1) == 0) isovalue += 0.3f;
    grid = {values.data(), samples.count, cells.first - samples.first, cells.count};
    spacing.set(lattice, level, cells, samples);
    GridGeometry geometry;
    geometry.spacing = glm::dvec3(0.5, 1.25, 2);
    if (randomInt(random, 0, 1) == 0) {
      const double c = std::cos(0.4), s = std::sin(0.4);
      geometry.direction = glm::dmat3(glm::dvec3(c, s, 0), glm::dvec3(-s, c, 0),
                                      glm::dvec3(0, 0, randomInt(random, 0, 1) == 0 ? 1 : -1));
    }
    frame = WorldFrame(geometry, {0.0f, 100.0f});
  }

  T at(const Index3& corner) const {
    return values[static_cast<std::size_t>(linearIndex(corner + grid.inset, grid.stored))];
  }
  bool isInside(const Index3& corner) const { return static_cast<float>(at(corner)) >= isovalue; }
  bool isCrossed(int axis, const Index3& corner) const {
    Index3 next = corner;
    ++next[axis];
    return next[axis] <= cells.count[axis] && isInside(corner) != isInside(next);
  }
  unsigned patternOf(const Index3& cell) const {
    unsigned pattern = 0;
    for (unsigned c = 0; c < 8; ++c)
      if (isInside(cell + Index3(c & 1, c >> 1 & 1, c >> 2))) pattern |= 1u << c;
    return pattern;
  }
};

template <typename F>
void forEachPlace(const Index3& count, F&& f) {
  Index3 i;
  for (i.z = 0; i.z < count.z; ++i.z)
    for (i.y = 0; i.y < count.y; ++i.y)
      for (i.x = 0; i.x < count.x; ++i.x) f(i);
}

using EdgeName = std::tuple<int, std::int64_t, std::int64_t, std::int64_t>;  // axis, k, j, i

TYPED_TEST(BrickKernels, AreThoseOfThePlainTwins) {
  using T = TypeParam;
  onEveryTarget([] {
    Random random(7);
    std::size_t crossings = 0;
    BrickRows rows;  // kept, as a mesher keeps it
    for (int round = 0; round < 120; ++round) {
      SCOPED_TRACE("round " + std::to_string(round));
      const RandomBrick<T> brick(random);
      const Index3& cells = brick.cells.count;
      const Index3 corners = cells + Index3(1);
      rows.resize(cells);
      rows.foreign_sides =
          randomInt(random, 0, 1) == 0 ? 0 : static_cast<unsigned>(randomInt(random, 0, 7));
      // Rows of cells without a crossing may be left out, and now and then are not.
      forEachPlace(Index3(cells.y, cells.z, 1), [&](const Index3& row) {
        bool crossed = randomInt(random, 0, 9) == 0;
        for (std::int64_t i = 0; i < cells.x; ++i) {
          const unsigned pattern = brick.patternOf(Index3(i, row.x, row.y));
          crossed = crossed || (pattern != 0 && pattern != 255);
        }
        if (crossed)
          for (std::int64_t i = 0; i < cells.x; ++i)
            rows.wantedCells(row.x, row.y)[i / 64] |= std::uint64_t{1} << i % 64;
      });
      const auto threshold = insideThreshold<T>(brick.isovalue);
      if (!threshold) continue;
      compareRows(brick.grid, *threshold, rows);
      numberRows(rows);

      // The twin: own crossings by axis, k, j, i; then what another brick says of its own.
      std::map<EdgeName, std::uint32_t> numbers;
      std::uint32_t next = 1000;
      const FirstVertices first = firstVertices(rows, 1000);
      std::vector<std::pair<int, Index3>> own;
      for (int axis = 0; axis < 3; ++axis) {
        const std::uint32_t before = next;
        forEachPlace(corners, [&](const Index3& c) {
          if (!brick.isCrossed(axis, c)) return;
          for (int a = 0; a < 3; ++a)
            if (a != axis && c[a] == 0 && (rows.foreign_sides >> a & 1) != 0) return;
          own.emplace_back(axis, c);
          numbers[{axis, c.z, c.y, c.x}] = next++;
        });
        ASSERT_EQ(rows.crossings[static_cast<std::size_t>(axis)], next - before);
      }
      std::uint32_t foreign = 5000000;
      for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        forEachPlace(Index3(1, corners.y, corners.z), [&](const Index3& row) {
          const auto r = static_cast<std::size_t>(rows.row(row.y, row.z));
          const bool foreign_row = (axis != 1 && row.y == 0 && (rows.foreign_sides & 2) != 0) ||
                                   (axis != 2 && row.z == 0 && (rows.foreign_sides & 4) != 0);
          if (axis > 0 && (rows.foreign_sides & 1) != 0 && brick.isCrossed(axis, row)) {
            rows.first_numbers[a - 1][r] = foreign - first[a];
            numbers[{axis, row.z, row.y, 0}] = foreign;
            foreign += 5;
          }
          if (!foreign_row) return;
          if (axis > 0 && (rows.foreign_sides & 1) == 0 && brick.isCrossed(axis, row))
            numbers[{axis, row.z, row.y, 0}] = foreign++;
          rows.numbers[a][r] = foreign - first[a];
          for (std::int64_t i = axis == 0 ? 0 : 1; i <= cells.x; ++i)
            if (brick.isCrossed(axis, Index3(i, row.y, row.z)))
              numbers[{axis, row.z, row.y, i}] = foreign++;
        });
      }
      std::vector<std::uint32_t> expected;
      for (const bool mirrored : {false, true}) {
        expected.clear();
        std::uint32_t crossed_cell_count = 0;
        forEachPlace(cells, [&](const Index3& cell) {
          const MarchingCubesCase& mc = marchingCubesTable()[brick.patternOf(cell)];
          crossed_cell_count += mc.triangle_count > 0 ? 1 : 0;
          for (std::size_t t = 0; t < mc.triangle_count; ++t)
            for (std::size_t n = 0; n < 3; ++n) {
              const std::size_t corner = mirrored && n > 0 ? 3 - n : n;
              const CellEdge& edge = kCellEdgeTable[mc.edges[3 * t + corner]];
              const auto found =
                  numbers.find({edge.axis, cell.z + edge.z, cell.y + edge.y, cell.x + edge.x});
              ASSERT_NE(found, numbers.end());
              expected.push_back(found->second);
            }
        });
        ASSERT_EQ(rows.triangles, expected.size() / 3);
        ASSERT_EQ(rows.crossed_cell_count, crossed_cell_count);
        std::vector<std::uint32_t> triangles(expected.size());
        makeTriangles(rows, first, mirrored, triangles.data());
        ASSERT_EQ(triangles, expected);
      }

      ASSERT_EQ(rows.ownCrossings(), own.size());
      std::vector<float> positions(3 * own.size()), normals(3 * own.size());
      makeCrossings(brick.grid, rows, brick.spacing, brick.frame, brick.isovalue, positions.data(),
                    normals.data());
      for (std::size_t v = 0; v < own.size(); ++v) {
        const Crossing twin = makeCrossing(brick.grid, brick.spacing, brick.frame, brick.isovalue,
                                           own[v].first, own[v].second);
        ASSERT_EQ(std::memcmp(&twin.position, &positions[3 * v], 12), 0) << "vertex " << v;
        ASSERT_EQ(std::memcmp(&twin.normal, &normals[3 * v], 12), 0) << "vertex " << v;
      }
      crossings += own.size();
    }
    EXPECT_GT(crossings, 10000u);
  });
}

TEST(InsideThreshold, IsTheLeastVoxelThatIsInside) {
  for (const float isovalue : {-1e9f, -129.0f, -128.0f, -3.5f, -0.5f, 0.0f, 0.1f, 126.5f, 127.0f,
                               127.5f, 254.9f, 255.0f, 255.1f, 1e9f})
    for (int v = -128; v <= 255; ++v) {
      const bool inside = static_cast<float>(v) >= isovalue;
      if (v >= 0) {
        const auto t = insideThreshold<std::uint8_t>(isovalue);
        EXPECT_EQ(t.has_value() && v >= *t, inside) << isovalue << " " << v;
      }
      if (v <= 127) {
        const auto t = insideThreshold<std::int8_t>(isovalue);
        EXPECT_EQ(t.has_value() && v >= *t, inside) << isovalue << " " << v;
      }
    }
}

}  // namespace
}  // namespace isobrick::test
