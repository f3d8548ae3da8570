// The estimate of the noise on fields whose noise is known.
#include "isobrick/storage/noise_estimate.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "isobrick/preprocess/pyramid_builder.h"
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
  return estimateNoise(Pyramid(folder.file("noisy.isb")));
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

}  // namespace
}  // namespace isobrick::test
