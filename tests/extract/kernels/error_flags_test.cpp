// The flags of the error oracle against a plain twin, bit by bit, on every instruction set of the
// machine.
#include "isobrick/extract/kernels/error_flags.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "tests/support/every_target.h"
#include "tests/support/random_numbers.h"

namespace isobrick::test {
namespace {

struct RandomRow {
  std::vector<float> value, low, high;

  // Of whole numbers, so that ends and crossings coincide often.
  RandomRow(Random& random, std::int64_t count) {
    const auto size = static_cast<std::size_t>(count + kErrorLanes);
    for (std::size_t i = 0; i < size; ++i) {
      value.push_back(static_cast<float>(randomInt(random, 0, 12)));
      const auto a = static_cast<float>(randomInt(random, 0, 24)) / 2;
      low.push_back(a);
      high.push_back(
          randomInt(random, 0, 2) == 0 ? a : a + static_cast<float>(randomInt(random, 0, 4)));
    }
  }
  BoundedRow row() const { return {value.data(), low.data(), high.data()}; }
};

std::uint8_t plainVoxelFlag(const RandomRow& row, std::size_t i, const ErrorBound& bound) {
  const float value = row.value[i] - bound.isovalue;
  const bool is_wrong = value >= 0 ? row.low[i] < bound.isovalue : row.high[i] >= bound.isovalue;
  return is_wrong && std::abs(value) > bound.tolerance ? kWrongSide : 0;
}

// [low, high] of both ends, less the isovalue.
bool isPlainTooFar(float value_a, float value_b, std::array<float, 2> a, std::array<float, 2> b,
                   float tolerance) {
  float from = 0, to = 1;
  const auto cut = [&](float bound_a, float bound_b) {
    const float root = bound_a / (bound_a - bound_b);
    if (bound_a < 0 && bound_b < 0)
      to = -1;
    else if (bound_a < 0)
      from = std::max(from, root);
    else if (bound_b < 0)
      to = std::min(to, root);
  };
  cut(-a[0], -b[0]);
  cut(a[1], b[1]);
  const auto errorAt = [&](float t) { return std::abs(value_a + t * (value_b - value_a)); };
  return std::min(a[0], b[0]) < 0 && from <= to + 0x1p-20f &&
         std::max(errorAt(from), errorAt(to)) > tolerance;
}

std::uint8_t plainEdgeFlags(const RandomRow& row, const RandomRow& other, std::size_t i,
                            const ErrorBound& bound) {
  const float a = row.value[i] - bound.isovalue, b = other.value[i] - bound.isovalue;
  const std::array<float, 2> coarse_a{row.low[i] - bound.isovalue, row.high[i] - bound.isovalue},
      coarse_b{other.low[i] - bound.isovalue, other.high[i] - bound.isovalue};
  unsigned flags = 0;
  if (isPlainTooFar(a, b, coarse_a, coarse_b, bound.tolerance)) flags |= kCoarseEdge;
  if (isPlainTooFar(a, b, coarse_a, {b, b}, bound.tolerance)) flags |= kLowHangs;
  if (isPlainTooFar(a, b, {a, a}, coarse_b, bound.tolerance)) flags |= kHighHangs;
  return static_cast<std::uint8_t>(flags);
}

TEST(ErrorFlags, AreThoseOfThePlainOnesOnEveryTarget) {
  onEveryTarget([] {
    Random random(3);
    std::array<int, 16> seen{};
    std::array<int, 2> rows_with{};
    for (int round = 0; round < 200; ++round) {
      const std::int64_t count = randomInt(random, 1, 130);
      const RandomRow row(random, count), other(random, count);
      const ErrorBound bound{static_cast<float>(randomInt(random, 0, 24)) / 2,
                             static_cast<float>(randomInt(random, -1, 8)) / 2};
      std::vector<std::uint8_t> flags(row.value.size(), 0);
      flagVoxels(row.row(), count, bound, flags.data());
      for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i) {
        ASSERT_EQ(flags[i], plainVoxelFlag(row, i, bound));
        ++seen[flags[i]];
      }
      std::fill(flags.begin(), flags.end(), std::uint8_t{0});
      flagEdges(row.row(), other.row(), count, bound, flags.data());
      for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i) {
        ASSERT_EQ(flags[i], plainEdgeFlags(row, other, i, bound)) << "edge " << i;
        ++seen[flags[i]];
      }
      // Of some edges, which may be none.
      const auto most = static_cast<std::size_t>(std::min<std::int64_t>(count, 32));
      for (int some = 0; some < 3; ++some) {
        std::uint32_t edges = 0;
        bool has_any = false;
        for (std::size_t i = 0; i < most; ++i) {
          if (randomInt(random, 0, some == 0 ? 1 : 8) != 0) continue;
          edges |= std::uint32_t{1} << i;
          has_any = has_any || (flags[i] & kCoarseEdge) != 0;
        }
        ASSERT_EQ(hasCoarseEdge(row.row(), other.row(), edges, bound), has_any) << edges;
        ++rows_with[has_any ? 1 : 0];
      }
    }
    EXPECT_GT(std::min(rows_with[0], rows_with[1]), 50);
    for (const int flag : {kWrongSide, kCoarseEdge, kLowHangs, kHighHangs})
      EXPECT_GT(seen[static_cast<std::size_t>(flag)], 50) << flag;
  });
}

}  // namespace
}  // namespace isobrick::test
