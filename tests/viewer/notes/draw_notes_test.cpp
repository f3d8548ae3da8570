// Scale bars measure, axes point, legends have the colours, and text is there to be read.
#include "isobrick/viewer/notes/draw_notes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace isobrick {
namespace {

Image pictureOf(int width, int height, float light) {
  const auto floats = 3 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  return {width, height, std::vector<float>(floats, light)};
}

float greenAt(const Image& image, int x, int y) { return image.rgb[image.offsetOf(x, y) + 1]; }

glm::vec3 screenColorAt(const Image& image, int x, int y) {
  const float* const rgb = image.rgb.data() + image.offsetOf(x, y);
  return {srgbFromLinear(rgb[0]), srgbFromLinear(rgb[1]), srgbFromLinear(rgb[2])};
}

TEST(ScaleBarTest, LengthsAreRoundAndAsLongAsFits) {
  for (double per_pixel = 1e-9; per_pixel < 1e9; per_pixel *= 1.37) {
    const ScaleBar bar = scaleBarOf(per_pixel, 200.0);
    EXPECT_LE(bar.pixels, 200.0 * (1 + 1e-12));
    EXPECT_GT(bar.pixels, 200.0 / 2.5 * (1 - 1e-12));
    EXPECT_NEAR(bar.pixels * per_pixel, bar.length, 1e-9 * bar.length);
    const double digit = bar.length / std::pow(10.0, std::floor(std::log10(bar.length) + 1e-9));
    EXPECT_LT(std::min({std::abs(digit - 1), std::abs(digit - 2), std::abs(digit - 5)}), 1e-6);
  }
  EXPECT_EQ(scaleBarOf(0.0, 100.0).length, 0.0);
  EXPECT_EQ(scaleBarOf(std::nan(""), 100.0).length, 0.0);
}

TEST(ScaleBarTest, LengthsHaveTheirUnitIfItIsKnown) {
  EXPECT_EQ(lengthText(50.0, LengthUnit::kMillimetre), "50 mm");
  EXPECT_EQ(lengthText(0.02, LengthUnit::kMillimetre), "20 \u00b5m");
  EXPECT_EQ(lengthText(20000.0, LengthUnit::kMillimetre), "20 m");
  EXPECT_EQ(lengthText(0.02, LengthUnit::kUnknown), "0.02");
  EXPECT_EQ(lengthText(20000.0, LengthUnit::kUnknown), "20000");
}

// The bar on the ground is as long as it says, at the target's distance.
TEST(DrawNotesTest, TheScaleBarMeasures) {
  PictureNotes notes;
  notes.scale_bar = true;
  for (const bool orthographic : {false, true}) {
    Image image = pictureOf(600, 400, 0.0f);
    PlacedCamera camera;
    camera.orthographic = orthographic;
    camera.half_height = orthographic ? 40.0 : 0.25;
    const double distance = 160.0;  // 0.25 * 160 is 40, so a pixel is 0.2 in both
    drawNotes(notes, camera, distance, image);
    const int row = 400 - static_cast<int>(std::lround(400.0 / 36.0));
    int first = 600, last = -1;
    for (int x = 0; x < 600; ++x)
      if (std::max(greenAt(image, x, row), greenAt(image, x, row - 1)) > 0.5f) {
        first = std::min(first, x);
        last = std::max(last, x);
      }
    // 150 pixels would be 30: the bar is 20, its ends are round.
    EXPECT_NEAR(last - first, 20.0 / 0.2, 3.0);
  }
}

TEST(DrawNotesTest, AxesPointAsTheCameraSeesThem) {
  Image image = pictureOf(360, 360, 0.0f);
  PictureNotes notes;
  notes.axes = true;
  drawNotes(notes, PlacedCamera{}, 1.0, image);  // looks along +y: x to the right, z up
  const glm::dvec2 foot(36.0, 324.0);
  const glm::vec3 x = screenColorAt(image, static_cast<int>(foot.x) + 15, static_cast<int>(foot.y));
  EXPECT_GT(x.r, 0.7f);
  EXPECT_LT(x.g, 0.5f);
  const glm::vec3 z = screenColorAt(image, static_cast<int>(foot.x), static_cast<int>(foot.y) - 15);
  EXPECT_GT(z.b, 0.7f);
  EXPECT_LT(z.r, 0.5f);
}

TEST(DrawNotesTest, TheLegendHasTheColoursOfTheSurfaces) {
  Image image = pictureOf(720, 720, 0.1f);
  image.alpha.assign(720 * 720, 0.25f);
  PictureNotes notes;
  notes.legend = true;
  notes.meaning.patches = {{{0.9f, 0.2f, 0.1f}, "isovalue 580"}, {{0.1f, 0.6f, 0.9f}, "\u00b5"}};
  notes.meaning.ramp = {{-3.0, 12.5}};
  notes.meaning.ramp_colors = ColorMap::kCividis;
  drawNotes(notes, PlacedCamera{}, 1.0, image);
  const int unit = 20;
  for (const int patch : {0, 1}) {
    const int y = unit + patch * 28 + 10;
    const glm::vec3 seen = screenColorAt(image, 30, y);
    for (glm::length_t c = 0; c < 3; ++c)
      EXPECT_NEAR(seen[c], notes.meaning.patches[static_cast<std::size_t>(patch)].color[c], 0.01f);
    EXPECT_EQ(image.alpha[image.offsetOf(30, y) / 3], 1.0f);
  }
  const glm::vec3 dark = screenColorAt(image, 21, unit + 56 + 8),
                  first = valueColor(ColorMap::kCividis, 0.0);
  const glm::vec3 light = screenColorAt(image, 198, unit + 56 + 8),
                  last = valueColor(ColorMap::kCividis, 1.0);
  for (glm::length_t c = 0; c < 3; ++c) {
    EXPECT_NEAR(dark[c], first[c], 0.03f);
    EXPECT_NEAR(light[c], last[c], 0.03f);
  }
  EXPECT_EQ(image.alpha[image.offsetOf(700, 700) / 3], 0.25f);  // nothing is there
}

// Whatever its size is: no ground shines through.
TEST(DrawNotesTest, TheRampHidesItsGround) {
  PictureNotes notes;
  notes.legend = true;
  notes.meaning.ramp = {{0.0, 1.0}};
  for (const int size : {96, 500, 719, 1024}) {
    Image image = pictureOf(size, size, 0.0f);
    image.alpha.assign(image.rgb.size() / 3, 0.0f);
    drawNotes(notes, PlacedCamera{}, 1.0, image);
    const double m = std::max(6.0, size / 36.0);
    const int y = static_cast<int>(m + 0.4 * m);
    for (int x = static_cast<int>(m) + 2; x < static_cast<int>(9.5 * m); ++x)
      ASSERT_EQ(image.alpha[image.offsetOf(x, y) / 3], 1.0f) << size << " " << x;
  }
}

// A view file may say anything.
TEST(DrawNotesTest, MarksFarAwayEndAtThePicture) {
  Image image = pictureOf(200, 200, 0.0f);
  PictureNotes notes;
  notes.legend = true;
  notes.meaning.patches.resize(5000, {glm::vec3(0.5f), "isovalue"});
  for (const double far : {1e30, -1e30, 1e300})
    notes.marks.push_back({{{0.0, 1.0, 0.0}, {far, 1.0, far}}, "far"});
  drawNotes(notes, PlacedCamera{}, 1.0, image);
  for (const float value : image.rgb) EXPECT_TRUE(std::isfinite(value));
}

TEST(DrawNotesTest, NothingIsDrawnUnlessAsked) {
  Image image = pictureOf(50, 50, 0.3f);
  const std::vector<float> before = image.rgb;
  drawNotes({}, PlacedCamera{}, 1.0, image);
  EXPECT_EQ(image.rgb, before);
}

// Black on white, white on black.
TEST(DrawNotesTest, TextStandsOutFromItsGround) {
  PictureNotes notes;
  notes.scale_bar = true;
  for (const float ground : {0.0f, 1.0f}) {
    Image image = pictureOf(400, 400, ground);
    drawNotes(notes, PlacedCamera{}, 1.0, image);
    const auto [least, most] = std::minmax_element(image.rgb.begin(), image.rgb.end());
    EXPECT_GT(*most - *least, 0.75f);
  }
}

TEST(PictureCanvasTest, TextIsWhereItIsSaidToBe) {
  Image image = pictureOf(300, 100, 0.0f);
  PictureCanvas canvas(image, 24.0);
  canvas.text({50.0, 60.0}, "AVAVA", glm::vec3(1.0f), glm::vec3(0.0f));
  double left = 300.0, right = 0.0, top = 100.0, bottom = 0.0;
  for (int y = 0; y < 100; ++y)
    for (int x = 0; x < 300; ++x)
      if (greenAt(image, x, y) > 0.3f) {
        left = std::min<double>(left, x);
        right = std::max<double>(right, x);
        top = std::min<double>(top, y);
        bottom = std::max<double>(bottom, y);
      }
  EXPECT_NEAR(left, 50.0, 2.0);
  EXPECT_NEAR(right, 50.0 + canvas.widthOf("AVAVA"), 2.0);
  EXPECT_NEAR(bottom, 60.0, 1.5);
  EXPECT_NEAR(bottom - top, 0.62 * 24.0, 3.0);  // of capitals
  // A pair of letters may be closer than its parts (kerning).
  EXPECT_LT(canvas.widthOf("AV"), canvas.widthOf("A") + canvas.widthOf("V") - 0.3);
}

// However far a mark reaches, only the picture's pixels are visited, and it goes where it goes.
TEST(PictureCanvasTest, FarMarksAreCutOffAtThePicture) {
  const double inf = std::numeric_limits<double>::infinity();
  Image image = pictureOf(300, 100, 0.0f);
  PictureCanvas canvas(image, 24.0);
  const glm::vec3 white(1.0f), black(0.0f);
  canvas.line({10.0, 50.0}, {1e30, 50.0}, 3.0, white);
  canvas.line({150.0, -1e12}, {150.0, 1e12}, 3.0, white);
  for (const int x : {12, 100, 299}) EXPECT_GT(greenAt(image, x, 50), 0.9f) << x;
  for (const int y : {0, 99}) EXPECT_GT(greenAt(image, 150, y), 0.9f) << y;
  EXPECT_EQ(greenAt(image, 100, 40), 0.0f);
  EXPECT_EQ(greenAt(image, 5, 50), 0.0f);

  const std::vector<float> before = image.rgb;
  for (const double far : {1e5, 1e30, inf, -1e5, -1e30, -inf, std::nan("")}) {
    canvas.line({far, far}, {far, 2.0 * far}, 3.0, white);
    canvas.box({far, 0.0}, {far, 50.0}, white);
    canvas.text({far, 50.0}, "far", white, black);
    canvas.text({50.0, far}, "far", white, black);
  }
  canvas.text({290.0, 500.0}, "\xff\xc3", white, black);
  EXPECT_EQ(image.rgb, before);

  canvas.text({290.0, 50.0}, "\xff\xc3", white, black);  // no UTF-8
  canvas.text({10.0, 95.0}, std::string(1'000'000, 'W'), white, black);
  canvas.box({-1e30, -1e30}, {1e30, 1e30}, white);
  EXPECT_EQ(*std::min_element(image.rgb.begin(), image.rgb.end()), 1.0f);
}

// Letters that the border of the picture cuts are as they would be in a larger one.
TEST(PictureCanvasTest, TextIsCutAtTheBorder) {
  Image whole = pictureOf(300, 120, 0.2f), part = pictureOf(120, 40, 0.2f);
  PictureCanvas on_whole(whole, 24.0), on_part(part, 24.0);
  on_whole.text({80.25, 60.0}, "cut at both", glm::vec3(1.0f), glm::vec3(0.0f));
  on_part.text({-19.75, 10.0}, "cut at both", glm::vec3(1.0f), glm::vec3(0.0f));
  const int radius = 2;  // of the margin around letters
  for (int y = radius; y < 40 - radius; ++y)
    for (int x = radius; x < 120 - radius; ++x)
      EXPECT_NEAR(greenAt(part, x, y), greenAt(whole, x + 100, y + 50), 1e-6f) << x << " " << y;
}

}  // namespace
}  // namespace isobrick
