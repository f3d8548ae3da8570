// The colours of values are in order by their lightness, and in even steps.
#include "isobrick/extract/color_map.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <set>

namespace isobrick {
namespace {

// L* of CIE 1976, 0 black .. 100 white.
double lightnessOf(const glm::vec3& srgb) {
  const double luminance = 0.2126 * static_cast<double>(linearFromSrgb(srgb.r)) +
                           0.7152 * static_cast<double>(linearFromSrgb(srgb.g)) +
                           0.0722 * static_cast<double>(linearFromSrgb(srgb.b));
  return luminance > 0.008856 ? 116.0 * std::cbrt(luminance) - 16.0 : 903.3 * luminance;
}

TEST(ColorMapTest, ColoursGetLighterEvenly) {
  for (const ColorMap map :
       {ColorMap::kViridis, ColorMap::kCividis, ColorMap::kInferno, ColorMap::kGrey}) {
    const double first = lightnessOf(valueColor(map, 0.0)),
                 last = lightnessOf(valueColor(map, 1.0));
    EXPECT_GT(last - first, 70.0);
    double before = first - 1e-3;
    for (int i = 0; i <= 160; ++i) {
      const double share = i / 160.0, lightness = lightnessOf(valueColor(map, share));
      EXPECT_GT(lightness, before) << static_cast<int>(map) << " " << share;
      EXPECT_NEAR(lightness, first + share * (last - first), 6.0) << share;
      before = lightness;
    }
  }
}

TEST(ColorMapTest, TheDivergingMapIsLightestInItsMiddle) {
  const double middle = lightnessOf(valueColor(ColorMap::kCoolWarm, 0.5));
  for (int i = 0; i < 16; ++i) {
    const double share = i / 32.0;
    const double low = lightnessOf(valueColor(ColorMap::kCoolWarm, share));
    EXPECT_LT(low, middle);
    EXPECT_NEAR(low, lightnessOf(valueColor(ColorMap::kCoolWarm, 1.0 - share)), 4.0) << share;
  }
  const glm::vec3 cool = valueColor(ColorMap::kCoolWarm, 0.0),
                  warm = valueColor(ColorMap::kCoolWarm, 1.0);
  EXPECT_GT(cool.b, cool.r);
  EXPECT_GT(warm.r, warm.b);
}

TEST(ColorMapTest, SharesBeyondTheEndsHaveTheColoursOfTheEnds) {
  EXPECT_EQ(valueColor(ColorMap::kViridis, -3.0), valueColor(ColorMap::kViridis, 0.0));
  EXPECT_EQ(valueColor(ColorMap::kViridis, 7.0), valueColor(ColorMap::kViridis, 1.0));
}

TEST(ColorMapTest, ComponentsHaveSevenColoursRoundAndRound) {
  std::set<std::array<int, 3>> colors;
  for (std::size_t place = 0; place < kComponentColorCount; ++place) {
    const glm::vec3 color = 255.0f * componentColor(place);
    colors.insert({static_cast<int>(std::lround(color.r)), static_cast<int>(std::lround(color.g)),
                   static_cast<int>(std::lround(color.b))});
    EXPECT_EQ(componentColor(place + 7), componentColor(place));
    EXPECT_EQ(componentColor(place + 7'000'000), componentColor(place));
  }
  // Okabe and Ito's table, in percent: without its black.
  EXPECT_EQ(colors, (std::set<std::array<int, 3>>{{230, 159, 0},
                                                  {86, 180, 233},
                                                  {0, 158, 115},
                                                  {240, 228, 66},
                                                  {0, 114, 178},
                                                  {213, 94, 0},
                                                  {204, 121, 167}}));
}

}  // namespace
}  // namespace isobrick
