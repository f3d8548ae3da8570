// The errors along rows of voxels against points that are tried one by one.
#include "isobrick/preprocess/kernels/error_rows.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <vector>

#include "tests/support/every_target.h"
#include "tests/support/random_numbers.h"

namespace isobrick::test {
namespace {

constexpr std::int64_t kStep = 4;  // voxels of a cell
const std::vector<float> kEnds = {
    -std::numeric_limits<float>::infinity(), 10.3f, 20.6f, 30.9f, 41.2f,
    std::numeric_limits<float>::infinity()};
const auto kBins = static_cast<std::int64_t>(kEnds.size()) - 1;

struct Row {
  std::vector<float> value, low, high;
  std::vector<BinRun> bins;

  Row(Random& random, std::int64_t count, bool is_clipped) {
    for (std::int64_t x = 0; x < errorRowStride(count); ++x) {
      const auto a = static_cast<float>(randomInt(random, 0, 50));
      const auto b = static_cast<float>(randomInt(random, 0, 50));
      value.push_back(static_cast<float>(randomInt(random, 0, 50)));
      low.push_back(std::min(a, b));
      high.push_back(is_clipped ? 45.0f : std::max(a, b));
    }
    bins.resize(value.size());
    const std::vector<float> from_low = low, from_high = high;
    boundRow({from_low.data(), from_low.data(), from_high.data(), from_high.data(), 0, 0, nullptr},
             value.data(), count, {kEnds.data(), kBins}, low.data(), high.data(), bins.data());
  }
  BracketedRow bracketed() const { return {value.data(), low.data(), high.data(), bins.data()}; }
};

// A voxel, or a point of an edge.
struct Point {
  float value, low, high;
};
Point pointOf(const Row& row, std::int64_t x) {
  const auto i = static_cast<std::size_t>(x);
  return {row.value[i], row.low[i], row.high[i]};
}

float crossingError(const Point& p, float least, float most) {
  const float up = std::max(p.low, least), down = std::min(p.high, most);
  if (up > down) return 0;
  return std::max({0.0f, p.value - up, down - p.value});
}
float wrongSideError(const Point& p, float least, float most) {
  const float up = std::max(p.low, least), down = std::min(p.high, most);
  return std::max({0.0f, up <= most ? p.value - up : 0, down >= least ? down - p.value : 0});
}
float edgeError(const Point& a, const Point& b, float least, float most) {
  constexpr int kPoints = 200;
  float greatest = 0;
  for (int i = 0; i <= kPoints; ++i) {
    const float t = static_cast<float>(i) / kPoints;
    const Point p = {a.value + t * (b.value - a.value), a.low + t * (b.low - a.low),
                     a.high + t * (b.high - a.high)};
    greatest = std::max(greatest, crossingError(p, least, most));
  }
  return greatest;
}

TEST(ErrorRows, AreTheGreatestErrorsOfEachBin) {
  onEveryTarget([] {
    Random random(4);
    std::vector<float> is_end;
    for (std::int64_t x = 0; x < 8 + kErrorRun; ++x) is_end.push_back(x % kStep == 0 ? 1.0f : 0);
    for (const std::int64_t count : {std::int64_t{6}, 2 * kErrorRun + 1, 2 * kErrorRun + 5}) {
      const bool is_clipped = randomInt(random, 0, 1) == 0;
      const Row rows[] = {Row(random, count, is_clipped), Row(random, count, is_clipped),
                          Row(random, count, is_clipped)};
      const std::int64_t stride = errorRowStride(count);
      std::vector<float> errors(static_cast<std::size_t>(kBins * stride), 0.0f);
      std::vector<RunBits> touched(static_cast<std::size_t>(kBins), 0);
      ErrorTargets targets;
      targets.rows[0] = {errors.data(), touched.data(), true, true};
      targets.count = 1;
      targets.row_stride = stride;
      targets.is_end = is_end.data();
      const IsovalueBins bins = {kEnds.data(), kBins};
      includeErrorsOfRow(rows[0].bracketed(), rows[1].bracketed(), rows[2].bracketed(), count, bins,
                         targets);
      targets.rows[0].has_y_edges = targets.rows[0].has_z_edges = false;
      for (int row = 1; row < 3; ++row)
        includeErrorsOfRow(rows[row].bracketed(), {}, {}, count, bins, targets);

      for (std::int64_t bin = 0; bin < kBins; ++bin)
        for (std::int64_t first = 0; first < count - 1; first += kStep) {
          const float least = kEnds[static_cast<std::size_t>(bin)];
          const float most = kEnds[static_cast<std::size_t>(bin) + 1];
          float expected = 0, found = 0;
          const std::int64_t last = std::min(first + kStep, count - 1);
          for (std::int64_t x = first; x <= last; ++x) {
            for (const Row& row : rows) {
              expected = std::max(expected, wrongSideError(pointOf(row, x), least, most));
              if (x < last)
                expected = std::max(expected,
                                    edgeError(pointOf(row, x), pointOf(row, x + 1), least, most));
              expected =
                  std::max(expected, edgeError(pointOf(rows[0], x), pointOf(row, x), least, most));
            }
            const float error = errors[static_cast<std::size_t>(bin * stride + x)];
            found = std::max(found, error);
            if (error > 0) {
              EXPECT_NE(touched[static_cast<std::size_t>(bin)] >> (x / kErrorRun) & 1, 0);
            }
          }
          // The points lie apart, and both ends may change by 50 on the way.
          ASSERT_LE(expected, found + 1e-3f) << "bin " << bin << ", cell at " << first;
          ASSERT_LE(found, expected + 2 * 50.0f / 200) << "bin " << bin << ", cell at " << first;
        }
    }
  });
}

}  // namespace
}  // namespace isobrick::test
