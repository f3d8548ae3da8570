// The bounds of the coarse field against a plain twin, bit by bit, on every instruction set of the
// machine.
#include "isobrick/extract/kernels/field_bounds.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "tests/support/every_target.h"
#include "tests/support/random_numbers.h"

namespace isobrick::test {
namespace {

template <typename T>
void comparesWithPlainBounds(Random& random) {
  const std::int64_t voxels = randomInt(random, 2, 257), last_voxel = voxels - 1;
  const std::int64_t samples = (last_voxel + 1) / 2 + 1;
  const auto randomRow = [&](std::int64_t count) {
    std::vector<T> row(static_cast<std::size_t>(count));
    for (T& value : row) value = static_cast<T>(randomInt(random, 0, 100));
    return row;
  };
  const int rows = 1 << randomInt(random, 0, 2);
  std::vector<std::vector<T>> fine, coarse;
  SampleRows<T> around;
  for (int n = 0; n < rows; ++n) {
    fine.push_back(randomRow(voxels));
    coarse.push_back(randomRow(samples));
  }
  for (const std::vector<T>& row : fine) around.voxels[around.count++] = row.data();
  for (std::size_t n = 0; n < coarse.size(); ++n) around.samples[n] = coarse[n].data();
  around.last_voxel = last_voxel;
  const std::int64_t first = randomInt(random, 0, last_voxel) / 2 * 2;
  const std::int64_t last = randomInt(random, first, last_voxel);
  const std::vector<T> own = randomRow(voxels);

  constexpr float kUntouched = -7.0f;
  std::array<std::vector<float>, 3> found;
  for (auto& row : found) row.assign(static_cast<std::size_t>(voxels), kUntouched);
  boundField(around, own.data(), first, last, found[0].data(), found[1].data(), found[2].data());

  const auto voxelOf = [&](std::int64_t sample) { return std::min(2 * sample, last_voxel); };
  const auto sumAt = [&](std::int64_t sample, bool greater) {
    const auto s = static_cast<std::size_t>(sample);
    float sum = 0;
    for (std::size_t n = 0; n < fine.size(); ++n) {
      const auto a = static_cast<float>(fine[n][static_cast<std::size_t>(voxelOf(sample))]);
      const auto b = static_cast<float>(coarse[n][s]);
      sum += greater ? std::max(a, b) : std::min(a, b);
    }
    return sum;
  };
  const float share = 1.0f / static_cast<float>(rows);
  for (std::int64_t x = 0; x < voxels; ++x) {
    const auto at = static_cast<std::size_t>(x);
    std::array<float, 3> expected = {kUntouched, kUntouched, kUntouched};
    if (x >= first && x <= last) {
      expected[0] = static_cast<float>(own[at]);
      for (const bool greater : {false, true}) {
        float& bound = expected[greater ? 2 : 1];
        if (x % 2 == 0 || x == last_voxel)
          bound = share * sumAt((x + 1) / 2, greater);
        else
          bound = 0.5f * share * (sumAt(x / 2, greater) + sumAt(x / 2 + 1, greater));
      }
    }
    for (std::size_t kind = 0; kind < 3; ++kind)
      ASSERT_EQ(found[kind][at], expected[kind]) << x << " of " << voxels << ", " << kind;
  }
}

// Also where sums of values are infinite: of a volume that marks voxels without a value by the
// lowest one, say.
TEST(FieldBounds, AreFiniteForAllFiniteValues) {
  onEveryTarget([] {
    constexpr float kLowest = std::numeric_limits<float>::lowest();
    const std::vector<float> row(3, kLowest);
    SampleRows<float> around;
    around.last_voxel = 2;
    for (; around.count < 4; ++around.count) {
      around.voxels[around.count] = row.data();
      around.samples[around.count] = row.data();
    }
    std::vector<float> value(3), low(3), high(3);
    boundField(around, row.data(), 0, 2, value.data(), low.data(), high.data());
    EXPECT_EQ(low, row);
    EXPECT_EQ(high, row);
  });
}

TEST(FieldBounds, AreThePlainOnesOnEveryTarget) {
  onEveryTarget([] {
    Random random(11);
    for (int round = 0; round < 100; ++round) {
      comparesWithPlainBounds<std::uint8_t>(random);
      comparesWithPlainBounds<std::int16_t>(random);
      comparesWithPlainBounds<float>(random);
    }
  });
}

}  // namespace
}  // namespace isobrick::test
