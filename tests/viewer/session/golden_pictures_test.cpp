// Views as pictures, held against those of an earlier day (tests/golden/pictures) by their
// structural similarity: shading, ambient occlusion, levels, edges, caps, slices, what is seen
// through, transitions, colours of values.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <string>
#include <vector>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/image.h"
#include "isobrick/viewer/offscreen_renderer.h"
#include "isobrick/viewer/view_picture.h"
#include "tests/support/field_pyramid.h"
#include "tests/support/picture_similarity.h"
#include "tests/support/png_reader.h"
#include "tests/support/requirement.h"
#include "tests/support/test_paths.h"
#include "tests/support/two_balls.h"

namespace isobrick {
namespace {

constexpr int kWidth = 160, kHeight = 120;

Image pictureOf(const std::shared_ptr<const Pyramid>& pyramid, const ViewState& state,
                int threads) {
  Image picture;
  OffscreenRenderer renderer;
  renderer.drawViews(pyramid, {&state, 1}, {kWidth, kHeight, threads, false}, CancelFlag(),
                     [&](ViewRows rows) { appendRows(rows.rows, picture); });
  return picture;
}

// ISOBRICK_WRITE_GOLDEN=1 writes them anew, to be looked at before they are kept.
TEST(GoldenPicturesTest, ViewsLookAsTheyDid) {
  const test::TemporaryFolder folder;
  BuildOptions options;
  options.brick_cells = 16;
  const auto pyramid = std::make_shared<const Pyramid>(test::buildField<std::uint8_t>(
      folder, Index3(48),
      [](const glm::dvec3& p) {
        const double shell = glm::distance(p, glm::dvec3(23.5));
        return std::clamp(
            128.0 + 6.0 * (17.0 - shell) + 25.0 * std::sin(0.6 * p.x) * std::sin(0.5 * p.z), 0.0,
            255.0);
      },
      options));
  ViewState plain;
  plain.camera.pivot = glm::dvec3(23.5);
  plain.camera.distance = 110.0;
  plain.focus = {{10.0, 10.0, 30.0}, 12.0, true, false};
  plain.surfaces[0].isovalue = 128.0;
  plain.value_window = {60.0, 255.0};
  std::vector<std::pair<std::string, ViewState>> views{{"shading", plain}};
  const auto add = [&](const char* name) -> ViewState& {
    return views.emplace_back(name, plain).second;
  };
  add("headlight").lighting = ViewLighting::kHeadlight;
  ViewState& hollow = add("hollow");
  hollow.clip_planes = {{{-0.6, 0.8, 0.0}, 6.0, true, false}};
  hollow.surfaces.push_back({200.0, {0.8f, 0.3f, 0.2f}, 1.0, true});
  hollow.camera.distance = 55.0;
  ViewState& near = add("near");
  near.camera.distance = 45.0;
  views.emplace_back("occlusion", near).second.ambient_occlusion = true;
  ViewState& levels = add("levels");
  levels.focus.everywhere = false;
  levels.focus.show_sphere = true;
  levels.coloring = ViewColoring::kLevel;
  levels.wireframe = true;
  ViewState& cap = add("cap");
  cap.clip_planes = {{{-0.6, 0.8, 0.0}, 6.0, true, true}};
  cap.camera.orthographic = true;
  ViewState& slices = add("slices");
  slices.slices = {{{true, 24.0}, {true, 30.0}, {true, 12.0}}};
  ViewState& two = add("two");
  two.surfaces.push_back({180.0, {0.8f, 0.3f, 0.2f}, 1.0, true});
  two.surfaces[0].opacity = 0.4;

  ViewState& transitions = add("transitions");
  transitions.focus.everywhere = false;
  transitions.show_transitions = true;
  ViewState& gradient = add("gradient");
  gradient.coloring = ViewColoring::kGradient;
  gradient.values.gradient_window = {{0.0, 16.0}};
  ViewState& other = add("other");
  other.coloring = ViewColoring::kOther;
  other.values.other = test::buildField<std::uint8_t>(
      folder, Index3(48), [](const glm::dvec3& p) { return 5.0 * p.x; }, options, {}, "other.isb");
  other.values.other_window = {{40.0, 200.0}};
  ViewState& distance = add("distance");
  distance.coloring = ViewColoring::kPlaneDistance;
  distance.values.plane = {{0.0, 0.0, 1.0}, 23.5};
  distance.values.plane_window = {{-20.0, 20.0}};
  distance.values.map = ColorMap::kCoolWarm;
  distance.pictures = {false, 1, true, true, true};
  ViewState& components = add("components");
  components.coloring = ViewColoring::kComponent;
  components.surfaces[0].isovalue = 216.0;
  components.camera.distance = 36.0;
  components.pictures = {false, 1, false, false, true};

  const std::string golden = std::string(test::goldenFolder()) + "/pictures/";
  std::vector<PictureBytes> drawn;
  for (const auto& [name, state] : views) {
    Image image;
    try {
      image = pictureOf(pyramid, state, 2);
    } catch (const Error& error) {
      SKIP_UNLESS_REQUIRED(error.what());
    }
    if (test::environmentSays("ISOBRICK_WRITE_GOLDEN")) writeImage(golden + name + ".png", image);
    drawn.push_back(test::bytesOf(image));
    const PictureBytes expected = test::readPng(golden + name + ".png", kWidth);
    EXPECT_GT(test::similarity(drawn.back(), expected), 0.98) << name;
  }
  // The measure tells them apart.
  for (std::size_t i = 1; i < drawn.size(); ++i)
    for (const std::size_t j : {std::size_t{0}, i - 1})
      EXPECT_LT(test::similarity(drawn[j], drawn[i]), 0.975)
          << views[j].first << " " << views[i].first;
}

// The first picture waits for the pieces, so it is the same whatever the threads do.
TEST(GoldenPicturesTest, PiecesAreKnownInEveryPicture) {
  const test::TemporaryFolder folder;
  const auto pyramid = test::openTwoBalls(folder);
  ViewState state;
  state.camera.pivot = pyramid->spec().geometry.indexToWorld(glm::dvec3(45));
  state.camera.distance = 90.0;
  state.camera.azimuth = 120.0;
  state.surfaces[0].isovalue = 0.0;
  state.focus.everywhere = true;
  state.show_box = false;
  state.coloring = ViewColoring::kComponent;
  std::vector<PictureBytes> drawn;
  for (const int threads : {1, 2, 3}) {
    try {
      drawn.push_back(test::bytesOf(pictureOf(pyramid, state, threads)));
    } catch (const Error& error) {
      SKIP_UNLESS_REQUIRED(error.what());
    }
    EXPECT_EQ(drawn.back().rgba, drawn.front().rgba);
  }
  // The large ball is orange, the small one sky blue, and no pixel has a colour of its own.
  std::size_t orange = 0, blue = 0;
  for (std::size_t i = 0; i + 3 < drawn[0].rgba.size(); i += 4) {
    const int red = drawn[0].rgba[i], third = drawn[0].rgba[i + 2];
    orange += red > third + 60;
    blue += third > red + 40;
  }
  EXPECT_GT(orange, 1000u);
  EXPECT_GT(blue, 200u);
  EXPECT_LT(blue, orange);
}

}  // namespace
}  // namespace isobrick
