// Statistics of the voxels: the noise of fields whose noise is known, and every voxel counted once.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>
#include <type_traits>
#include <utility>
#include <vector>

#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/storage/pyramid.h"
#include "tests/support/array_source.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

template <typename T, typename F>
double noiseOf(const F& field, double sigma, double outside) {
  const TemporaryFolder folder;
  std::mt19937 random(7);
  std::normal_distribution<double> normal(0, 1);
  const Index3 dims(70, 65, 60);
  ArraySource<T> source(dims, arrayOfField<T>(dims, [&](const Index3& at) {
                          const double value = field(at);
                          if (value == outside) return static_cast<T>(outside);
                          const double noisy = value + sigma * normal(random);
                          return static_cast<T>(std::is_integral_v<T> ? std::round(noisy) : noisy);
                        }));
  BuildOptions options;
  options.brick_cells = 32;
  options.with_curvature = false;
  buildPyramid(source, folder.file("noisy.isb"), options);
  return Pyramid(folder.file("noisy.isb")).noise();
}

double distanceFromMiddle(const Index3& at) {
  return std::hypot(static_cast<double>(at.x - 35), static_cast<double>(at.y - 32),
                    static_cast<double>(at.z - 30));
}

TEST(NoiseEstimate, IsTheSigmaOfTheNoise) {
  const auto ramp = [](const Index3& at) { return 400.0 + static_cast<double>(3 * at.x + at.y); };
  EXPECT_NEAR(noiseOf<std::uint16_t>(ramp, 20, -1), 20, 1);
  EXPECT_NEAR(noiseOf<float>(ramp, 0.25, -1), 0.25, 0.0125);
}

// Edges are few, and what was cut off has no noise.
TEST(NoiseEstimate, IsMovedLittleByEdgesAndNotByBackground) {
  const auto ball = [](const Index3& at) { return distanceFromMiddle(at) < 20 ? 1200.0 : 300.0; };
  EXPECT_NEAR(noiseOf<std::int16_t>(ball, 15, -1), 15, 1.5);
  const auto in_air = [](const Index3& at) { return distanceFromMiddle(at) < 25 ? 900.0 : 0.0; };
  EXPECT_NEAR(noiseOf<std::int16_t>(in_air, 15, 0), 15, 3);
}

TEST(NoiseEstimate, IsNothingWhereThereIsNone) {
  EXPECT_EQ(noiseOf<std::uint8_t>([](const Index3&) { return 7.0; }, 0, 7), 0);
  EXPECT_EQ(
      noiseOf<std::uint8_t>([](const Index3& at) { return static_cast<double>(at.x); }, 0, -1), 0);
}

template <typename T>
void expectEveryVoxelCountedOnce(const Index3& dims, std::int64_t brick_cells) {
  const TemporaryFolder folder;
  std::mt19937 random(11);
  std::vector<T> voxels(static_cast<std::size_t>(elementCount(dims)));
  for (T& voxel : voxels) {
    if constexpr (std::is_integral_v<T>)
      voxel = static_cast<T>(random() % 700);
    else
      voxel = static_cast<T>(std::ldexp(static_cast<double>(random() % 4000) - 2000.0,
                                        static_cast<int>(random() % 9) - 6));
  }
  voxels[3] = T{} * -1;
  ArraySource<T> source(dims, voxels);
  BuildOptions options;
  options.brick_cells = brick_cells;
  buildPyramid(source, folder.file("counted.isb"), options);
  const Pyramid pyramid(folder.file("counted.isb"));
  const VoxelHistogram histogram = pyramid.histogram();
  std::size_t bin = 0;
  std::sort(voxels.begin(), voxels.end());
  std::vector<std::uint64_t> expected(histogram.bins());
  for (const T voxel : voxels) {
    while (static_cast<float>(voxel) > histogram.bin(bin).max) ++bin;
    ASSERT_GE(static_cast<float>(voxel), histogram.bin(bin).min);
    ++expected[bin];
  }
  EXPECT_TRUE(std::equal(expected.begin(), expected.end(), histogram.counts().begin()));
  // Bins touch and do not overlap.
  for (std::size_t i = 0; i + 1 < histogram.bins(); ++i)
    EXPECT_LT(histogram.bin(i).max, histogram.bin(i + 1).min);
  const ValueRange range = pyramid.valueRange();
  const std::vector<double> parts = histogram.inEqualParts(range.min, range.max, 37);
  EXPECT_NEAR(std::accumulate(parts.begin(), parts.end(), 0.0), static_cast<double>(voxels.size()),
              1e-6);
}

TEST(VoxelHistogram, CountsEveryVoxelOnceInTheBinOfItsValue) {
  for (const auto& [dims, brick_cells] :
       {std::pair(Index3(37, 22, 19), 8), {Index3(9, 17, 33), 16}, {Index3(2, 2, 5), 4}}) {
    expectEveryVoxelCountedOnce<std::uint8_t>(dims, brick_cells);
    expectEveryVoxelCountedOnce<std::int8_t>(dims, brick_cells);
    expectEveryVoxelCountedOnce<std::uint16_t>(dims, brick_cells);
    expectEveryVoxelCountedOnce<std::int16_t>(dims, brick_cells);
    expectEveryVoxelCountedOnce<float>(dims, brick_cells);
  }
}

}  // namespace
}  // namespace isobrick::test
