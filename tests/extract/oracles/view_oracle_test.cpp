// The view oracle over volumes of any spacing and orientation, by brute force over their cells.
#include "isobrick/extract/oracles/view_oracle.h"

#include <gtest/gtest.h>

#include <cmath>
#include <glm/gtc/matrix_transform.hpp>
#include <numbers>

#include "isobrick/extract/kernels/row_bits.h"
#include "isobrick/storage/index_loop.h"
#include "tests/support/random_numbers.h"

namespace isobrick::test {
namespace {

struct ViewCase {
  Lattice lattice;
  GridGeometry geometry;
  ViewPoint view;
};

glm::dvec3 randomViewDirection(Random& random) {
  for (;;) {
    const glm::dvec3 v(randomReal(random, -1, 1), randomReal(random, -1, 1),
                       randomReal(random, -1, 1));
    if (glm::length(v) > 0.1) return v;
  }
}

ViewCase randomViewCase(Random& random) {
  ViewCase c;
  Index3 dims;
  for (int axis = 0; axis < 3; ++axis) dims[axis] = randomInt(random, 2, 40);
  c.lattice = Lattice(dims);
  for (int axis = 0; axis < 3; ++axis) {
    c.geometry.spacing[axis] = std::exp2(randomReal(random, -2, 2));
    c.geometry.origin[axis] = randomReal(random, -100, 100);
  }
  c.geometry.direction =
      glm::dmat3(glm::rotate(glm::dmat4(1), randomReal(random, 0, 6), randomViewDirection(random)));
  if (randomInt(random, 0, 1) == 0) c.geometry.direction[1] = -c.geometry.direction[1];
  glm::dvec3 eye;
  for (int axis = 0; axis < 3; ++axis)
    eye[axis] = randomReal(random, -1, 2) * static_cast<double>(dims[axis]);
  c.view.eye = c.geometry.indexToWorld(eye);
  c.view.pixels = std::exp2(randomReal(random, -2, 3));
  c.view.pixels_per_radian = std::exp2(randomReal(random, 0, 7));
  if (randomInt(random, 0, 4) == 0)
    c.view.pixels_per_unit = c.view.pixels * std::exp2(randomReal(random, -5, 1));
  if (randomInt(random, 0, 1) == 0)
    c.view.field = ViewPoint::Field{randomViewDirection(random), randomReal(random, 0.05, 1.55),
                                    randomReal(random, 0.5, 30)};
  return c;
}

// Whether any corner or the middle of a cell lies in the field, and how near it comes to the eye.
struct Seen {
  bool any = false;
  double nearest = 0;
};
Seen seenOf(const ViewCase& c, int level, const Index3& cell) {
  Seen seen;
  const double edge = std::ldexp(1.0, level);
  const glm::dvec3 eye = c.geometry.worldToIndex(c.view.eye);
  const glm::dvec3 low = glm::dvec3(cell) * edge;
  seen.nearest = glm::length((glm::clamp(eye, low, low + edge) - eye) * c.geometry.spacing);
  for (int n = 0; n < 9; ++n) {
    const glm::dvec3 at =
        low + (n == 8 ? glm::dvec3(0.5) : glm::dvec3(n & 1, n >> 1 & 1, n >> 2)) * edge;
    const glm::dvec3 from_eye = c.geometry.indexToWorld(at) - c.view.eye;
    if (!c.view.field) return {true, seen.nearest};
    const glm::dvec3 direction = glm::normalize(c.view.field->direction);
    const double ahead = glm::dot(from_eye, direction);
    const double beside = glm::length(from_eye - ahead * direction);
    seen.any =
        seen.any || (c.view.pixels_per_unit ? beside < c.view.field->radius
                                            : std::atan2(beside, ahead) < c.view.field->half_angle);
  }
  return seen;
}

bool touch(int level_a, const Index3& a, int level_b, const Index3& b) {
  for (int axis = 0; axis < 3; ++axis)
    if ((a[axis] + 1) << level_a < b[axis] << level_b || (b[axis] + 1) << level_b < a[axis]
                                                                                        << level_a)
      return false;
  return true;
}

TEST(ViewOracle, NoLeafThatIsSeenCoversMorePixelsThanAskedFor) {
  Random random(21);
  std::int64_t seen_leaves = 0, refined_away = 0;
  for (int round = 0; round < 150; ++round) {
    const ViewCase c = randomViewCase(random);
    const ViewOracle oracle(c.lattice, c.geometry, c.view);
    const double longest =
        std::max({c.geometry.spacing.x, c.geometry.spacing.y, c.geometry.spacing.z});
    for (int level = 1; level < c.lattice.levels(); ++level)
      forEachIndex({Index3(0), c.lattice.cells(level)}, [&](const Index3& cell) {
        if (oracle.refines(level, cell)) {
          ++refined_away;
          return;
        }
        const Seen seen = seenOf(c, level, cell);
        if (!seen.any) return;
        ++seen_leaves;
        const double edge = std::ldexp(longest, level);
        const double pixels = c.view.pixels_per_unit
                                  ? edge * *c.view.pixels_per_unit
                                  : edge / seen.nearest * c.view.pixels_per_radian;
        ASSERT_LE(pixels, c.view.pixels * (1 + 1e-9)) << "round " << round << " level " << level;
      });
  }
  EXPECT_GT(seen_leaves, 10000);
  EXPECT_GT(refined_away, 10000);
}

TEST(ViewOracle, TouchingLeavesDifferByOneLevelAndParentsOfRefinedCellsAreRefined) {
  Random random(22);
  std::int64_t pairs = 0;
  for (int round = 0; round < 120; ++round) {
    const ViewCase c = randomViewCase(random);
    const ViewOracle oracle(c.lattice, c.geometry, c.view);
    const int levels = c.lattice.levels();
    for (int level = 0; level + 1 < levels; ++level)
      forEachIndex({Index3(0), c.lattice.cells(level)}, [&](const Index3& cell) {
        const Index3 parent = cell / std::int64_t{2};
        if (oracle.refines(level, cell)) {
          ASSERT_TRUE(oracle.refines(level + 1, parent));
        }
        // A cell below a refined parent must not touch a leaf two levels up.
        if (!oracle.refines(level + 1, parent) || level + 2 >= levels) return;
        const Index3 first = glm::max((cell - Index3(1)) / std::int64_t{4}, Index3(0));
        const Index3 last =
            glm::min((cell + Index3(1)) / std::int64_t{4}, c.lattice.cells(level + 2) - Index3(1));
        forEachIndex({first, last - first + Index3(1)}, [&](const Index3& coarse) {
          if (!touch(level, cell, level + 2, coarse)) return;
          ++pairs;
          ASSERT_TRUE(oracle.refines(level + 2, coarse)) << "round " << round;
        });
      });
  }
  EXPECT_GT(pairs, 10000);
}

TEST(ViewOracle, RowsAndBoxesAgreeWithCells) {
  Random random(23);
  std::int64_t of_coverages[3] = {};
  for (int round = 0; round < 400; ++round) {
    const ViewCase c = randomViewCase(random);
    const ViewOracle oracle(c.lattice, c.geometry, c.view);
    for (int n = 0; n < 10; ++n) {
      const int level = static_cast<int>(randomInt(random, 0, c.lattice.levels()));
      const Index3 cells = c.lattice.cells(level);
      IndexBox box;
      for (int axis = 0; axis < 3; ++axis) {
        box.first[axis] = randomInt(random, 0, cells[axis] - 1);
        box.count[axis] =
            randomInt(random, 1, std::min<std::int64_t>(cells[axis] - box.first[axis], 6));
      }
      std::int64_t refined = 0;
      forEachIndex(box,
                   [&](const Index3& cell) { refined += oracle.refines(level, cell) ? 1 : 0; });
      const Coverage coverage = oracle.refinedCoverage(level, box);
      ++of_coverages[static_cast<int>(coverage)];
      ASSERT_TRUE(coverage != Coverage::kAll || refined == box.size());
      ASSERT_TRUE(coverage != Coverage::kNone || refined == 0);
      std::uint64_t bits = random();
      const std::uint64_t asked = bits;
      oracle.keepRefined(level, box.first, box.count.x, &bits);
      for (std::int64_t i = 0; i < box.count.x; ++i)
        ASSERT_EQ(bits >> i & 1, oracle.refines(level, box.first + Index3(i, 0, 0))
                                     ? asked >> i & 1
                                     : std::uint64_t{0});
    }
  }
  for (const std::int64_t count : of_coverages) EXPECT_GT(count, 100);
}

}  // namespace
}  // namespace isobrick::test
