// Isovalues that are suggested for volumes whose materials are known.
#include "isobrick/storage/isovalue_suggestions.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>
#include <string>
#include <type_traits>
#include <vector>

#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/storage/pyramid_parts.h"
#include "tests/support/array_source.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

using Field = std::function<double(const Index3&)>;

const Index3 kTissueVoxels(64, 60, 56);

double distanceFromCenter(const Index3& at) {
  return std::hypot(static_cast<double>(at.x) - 31.3, static_cast<double>(at.y) - 29.6,
                    static_cast<double>(at.z) - 27.8);
}

// Smooth over one voxel at the radius, as scanners see it.
double insideBall(const Index3& at, double radius) {
  return std::clamp(radius - distanceFromCenter(at) + 0.5, 0.0, 1.0);
}

bool isOutsideCircle(const Index3& at) {
  return std::hypot(static_cast<double>(at.x) - 31.5, static_cast<double>(at.y) - 29.5) > 28;
}

template <typename T>
Pyramid built(const TemporaryFolder& folder, const Field& field, double sigma,
              std::int64_t brick_cells = 32) {
  std::mt19937 random(5);
  std::normal_distribution<double> normal(0, 1);
  ArraySource<T> source(kTissueVoxels, arrayOfField<T>(kTissueVoxels, [&](const Index3& at) {
                          const double value = field(at) + (sigma > 0 ? sigma * normal(random) : 0);
                          return static_cast<T>(std::is_integral_v<T> ? std::round(value) : value);
                        }));
  BuildOptions options;
  options.brick_cells = brick_cells;
  options.with_curvature = false;
  const std::string path = folder.file("volume.isb");
  buildPyramid(source, path, options);
  return Pyramid(path);
}

template <typename T>
IsovalueSuggestions suggestedFor(const Field& field, double sigma) {
  const TemporaryFolder folder;
  return suggestIsovalues(built<T>(folder, field, sigma));
}

// One value between each two materials, further from both than the noise reaches.
void expectBetween(const IsovalueSuggestions& suggestions, const std::vector<double>& materials,
                   double sigma) {
  ASSERT_EQ(suggestions.values.size(), materials.size() - 1);
  std::vector<double> values;
  for (const IsovalueSuggestion& suggestion : suggestions.values)
    values.push_back(suggestion.value);
  std::sort(values.begin(), values.end());
  for (std::size_t i = 0; i < values.size(); ++i) {
    EXPECT_GT(values[i], materials[i] + 3 * sigma);
    EXPECT_LT(values[i], materials[i + 1] - 3 * sigma);
  }
}

// Air, tissue and bone of a head in a scanner.
double headValue(const Index3& at) {
  return -1000 + 1040 * insideBall(at, 22) + 1100 * insideBall(at, 11);
}

TEST(IsovalueSuggestions, LieBetweenMaterials) {
  const auto ball = [](const Index3& at) { return 300 + 900 * insideBall(at, 20); };
  expectBetween(suggestedFor<std::uint16_t>(ball, 0), {300, 1200}, 1);
  expectBetween(suggestedFor<std::uint16_t>(ball, 30), {300, 1200}, 30);
  expectBetween(suggestedFor<float>([&](const Index3& at) { return 1e-3 * ball(at); }, 0.03),
                {0.3, 1.2}, 0.03);
  const auto dark = [](const Index3& at) { return 3000 - 2700 * insideBall(at, 20); };
  expectBetween(suggestedFor<std::uint16_t>(dark, 30), {300, 3000}, 30);
}

TEST(IsovalueSuggestions, TheFirstIsTheObjectsOutside) {
  const IsovalueSuggestions head = suggestedFor<std::int16_t>(headValue, 15);
  expectBetween(head, {-1000, 40, 1140}, 15);
  EXPECT_LT(head.values.front().value, 40);
  EXPECT_FALSE(head.padding_least || head.padding_greatest);
}

// The circle of a scanner is not what it has scanned.
TEST(IsovalueSuggestions, PaddingIsNoMaterial) {
  for (const double padding : {-2000.0, -3024.0, -32768.0, 32767.0})
    for (const double sigma : {0.0, 15.0}) {
      SCOPED_TRACE(padding);
      std::mt19937 random(9);
      std::normal_distribution<double> normal(0, 1);
      const auto scan = [&](const Index3& at) {
        return isOutsideCircle(at) ? padding
                                   : headValue(at) + (sigma > 0 ? sigma * normal(random) : 0);
      };
      const IsovalueSuggestions found = suggestedFor<std::int16_t>(scan, 0);
      expectBetween(found, {-1000, 40, 1140}, std::max(sigma, 1.0));
      EXPECT_LT(found.values.front().value, 40);
      EXPECT_EQ(padding < 0 ? found.padding_least : found.padding_greatest, padding);
      EXPECT_FALSE(padding < 0 ? found.padding_greatest : found.padding_least);
    }
}

// Nothing is around it but what was cut away; that is no padding.
TEST(IsovalueSuggestions, AMaskedObjectHasItsOutside) {
  std::mt19937 random(9);
  std::normal_distribution<double> normal(0, 6);
  const auto brain = [&](const Index3& at) {
    const double distance = distanceFromCenter(at);
    return distance > 22 ? 0 : (distance > 15 ? 100 : 140) + normal(random);
  };
  const IsovalueSuggestions found = suggestedFor<std::uint8_t>(brain, 0);
  ASSERT_FALSE(found.values.empty());
  EXPECT_FALSE(found.padding_least);
  EXPECT_GT(found.values.front().value, 5);
  EXPECT_LT(found.values.front().value, 82);
}

TEST(IsovalueSuggestions, LabelsArePartedHalfWay) {
  const auto labels = [](const Index3& at) {
    const double distance = distanceFromCenter(at);
    return distance > 22 ? 0.0 : distance > 12 ? 1.0 : 2.0;
  };
  const IsovalueSuggestions found = suggestedFor<std::uint8_t>(labels, 0);
  ASSERT_EQ(found.values.size(), 2u);
  EXPECT_EQ(found.values[0].value, 0.5);
  EXPECT_EQ(found.values[1].value, 1.5);
  const IsovalueSuggestions mask = suggestedFor<std::int16_t>(
      [&](const Index3& at) { return labels(at) > 0 ? 100.0 : -100.0; }, 0);
  ASSERT_EQ(mask.values.size(), 1u);
  EXPECT_NEAR(mask.values[0].value, 0, 1);
}

// Things too thin to be a material: what is seen is half-way to their middle.
TEST(IsovalueSuggestions, ThinThingsAreFound) {
  const auto vessels = [](const Index3& at) {
    const double distance = std::hypot(
        std::remainder(static_cast<double>(at.x), 16.0),
        std::remainder(static_cast<double>(at.y) + 0.3 * static_cast<double>(at.z), 20.0));
    return std::floor(220 * std::exp(-distance * distance / 1.5));
  };
  const IsovalueSuggestions found = suggestedFor<std::uint8_t>(vessels, 0);
  ASSERT_FALSE(found.values.empty());
  EXPECT_GT(found.values.front().value, 20);
  EXPECT_LT(found.values.front().value, 150);
}

TEST(IsovalueSuggestions, ALevelSetIsSeenAtZero) {
  const IsovalueSuggestions found = suggestedFor<float>(
      [](const Index3& at) { return std::clamp(distanceFromCenter(at) - 18, -3.0, 3.0); }, 0);
  ASSERT_EQ(found.values.size(), 1u);
  EXPECT_NEAR(found.values[0].value, 0, 0.11);
}

// With noise of half the difference of two materials, no gradient tells them apart; their
// frequencies do. With one material there is nothing to tell apart, and its middle is as good as
// any.
TEST(IsovalueSuggestions, HeavyNoiseLeavesTheFrequencies) {
  const IsovalueSuggestions found = suggestedFor<std::int16_t>(
      [](const Index3& at) { return 1000 + 200 * insideBall(at, 24); }, 50);
  ASSERT_FALSE(found.values.empty());
  EXPECT_GT(found.values.front().value, 1040);
  EXPECT_LT(found.values.front().value, 1160);
  const IsovalueSuggestions noise =
      suggestedFor<std::int16_t>([](const Index3&) { return 1000; }, 50);
  ASSERT_EQ(noise.values.size(), 1u);
  EXPECT_NEAR(noise.values[0].value, 1000, 25);
}

TEST(IsovalueSuggestions, EqualVoxelsHaveNone) {
  const TemporaryFolder folder;
  const Pyramid pyramid = built<std::uint16_t>(
      folder, [](const Index3&) { return 7; }, 0);
  EXPECT_FALSE(pyramid.parts().tables().gradients());
  EXPECT_TRUE(suggestIsovalues(pyramid).values.empty());
}

// Files of earlier programs have frequencies alone.
TEST(IsovalueSuggestions, DoWithoutASpectrum) {
  const TemporaryFolder folder;
  const Pyramid pyramid = built<std::int16_t>(
      folder, [](const Index3& at) { return isOutsideCircle(at) ? -2000 : headValue(at); }, 0);
  const IsovalueSuggestions found =
      suggestIsovalues(pyramid.histogram(), pyramid.valueRange(), std::nullopt, pyramid.noise());
  ASSERT_EQ(found.values.size(), 1u);
  EXPECT_EQ(found.padding_least, -2000);
  EXPECT_GT(found.values[0].value, -990);
  EXPECT_LT(found.values[0].value, 30);
}

// All edges of a small volume are in the sample.
TEST(GradientSpectrum, SumsTheEdgesThatAnIsovalueCrosses) {
  const TemporaryFolder folder;
  // Large blocks, so that edges with different ends are few.
  const auto value = [](const Index3& at) {
    return static_cast<double>((at.x / 24 * 7 + at.y / 40 * 5 + at.z / 32 * 3) % 11 * 20);
  };
  const Pyramid pyramid = built<std::uint8_t>(folder, value, 0);
  const auto spectrum = pyramid.parts().tables().gradients();
  ASSERT_TRUE(spectrum);
  const double width = static_cast<double>(spectrum->width);
  for (std::size_t part = 0; part < spectrum->parts(); ++part) {
    const double first = static_cast<double>(spectrum->first) + static_cast<double>(part) * width;
    double area = 0, gradient = 0;
    for (std::int64_t z = 0; z < kTissueVoxels.z; ++z)
      for (std::int64_t y = 0; y < kTissueVoxels.y; ++y)
        for (std::int64_t x = 0; x < kTissueVoxels.x; ++x)
          for (int axis = 0; axis < 3; ++axis) {
            Index3 next(x, y, z);
            if (++next[axis] == kTissueVoxels[axis]) continue;
            const double a = value(Index3(x, y, z)), b = value(next);
            const double share =
                (std::min(std::max(a, b), first + width) - std::max(std::min(a, b), first)) / width;
            area += std::max(share, 0.0);
            gradient += std::max(share, 0.0) * std::abs(a - b);
          }
    const auto sum = [&](std::vector<float> GradientSpectrum::Edges::*numbers) {
      return static_cast<double>((spectrum->inner.*numbers)[part]) +
             static_cast<double>((spectrum->least.*numbers)[part]) +
             static_cast<double>((spectrum->greatest.*numbers)[part]);
    };
    EXPECT_NEAR(sum(&GradientSpectrum::Edges::area), area, 1e-5 * area + 1e-3);
    EXPECT_NEAR(sum(&GradientSpectrum::Edges::gradient), gradient, 1e-5 * gradient + 1e-3);
  }
}

TEST(GradientSpectrum, IsTheSameForAnyBricks) {
  std::vector<std::vector<float>> all;
  for (const std::int64_t brick_cells : {8, 32, 64}) {
    const TemporaryFolder folder;
    const auto spectrum =
        built<std::int16_t>(folder, headValue, 15, brick_cells).parts().tables().gradients();
    ASSERT_TRUE(spectrum);
    all.push_back(elementsOf(*spectrum));
  }
  EXPECT_EQ(all[0], all[1]);
  EXPECT_EQ(all[0], all[2]);
}

}  // namespace
}  // namespace isobrick::test
