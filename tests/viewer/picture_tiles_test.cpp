// Pictures of any size: drawn in tiles they are what they are in one piece, and written in bands
// what they are in memory.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <glm/geometric.hpp>
#include <thread>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/picture_writer.h"
#include "isobrick/viewer/render/gl_scene_renderer.h"
#include "isobrick/viewer/view_picture.h"
#include "tests/support/field_pyramid.h"
#include "tests/support/file_bytes.h"
#include "tests/support/gl_test.h"
#include "tests/support/null_renderer.h"
#include "tests/support/picture_similarity.h"
#include "tests/support/png_reader.h"

namespace isobrick {
namespace {

// ------------------------------------------------------------------------------ drawn in tiles

// A ball with waves, so that it shades itself, and another one inside of it.
double wavyBall(const glm::dvec3& p) {
  const double shell = glm::distance(p, glm::dvec3(23.5));
  return std::clamp(128.0 + 6.0 * (17.0 - shell) + 25.0 * std::sin(0.6 * p.x) * std::sin(0.5 * p.z),
                    0.0, 255.0);
}

class PictureTilesTest : public test::GlTest {
 protected:
  void setUp() override {
    renderer_ = std::make_unique<GlSceneRenderer>();
    BuildOptions build;
    build.brick_cells = 16;
    pyramid_ = std::make_shared<const Pyramid>(
        test::buildField<std::uint8_t>(folder_, Index3(48), wavyBall, build));
    plain_.camera.pivot = glm::dvec3(23.5);
    plain_.camera.distance = 80.0;
    plain_.focus = {{10.0, 10.0, 30.0}, 12.0, true, false};
    plain_.surfaces[0].isovalue = 128.0;
    plain_.value_window = {60.0, 255.0};
  }

  SceneWithNotes sceneOf(const ViewState& state, int width, int height) {
    session_.reset();
    session_ = std::make_unique<ViewSession>(pyramid_, *renderer_,
                                             SessionOptions{2, std::uint64_t{1} << 30});
    session_->apply(InputEvent::resized(width, height), 0.0, false);
    session_->show(state);
    for (double clock = 1.0; clock == 1.0 || !session_->settled(); clock += 1.0) {
      session_->update(clock);
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    return pictureSceneOf(*session_, width, height, true);
  }

  // The same drawn in one piece, and in tiles that begin at odd places.
  void expectTheSame(const std::string& name, const SceneWithNotes& scene) {
    const int width = scene.frame.width, height = scene.frame.height;
    const Image whole = drawWhole(*renderer_, scene, {4096, 1 << 30});
    const Image tiled = drawWhole(*renderer_, scene, {53, 41 * width});
    ASSERT_EQ(whole.width, width);
    ASSERT_EQ(tiled.width, width);
    ASSERT_EQ(whole.height, height);
    ASSERT_EQ(tiled.height, height);
    const PictureBytes a = test::bytesOf(whole), b = test::bytesOf(tiled);
    std::size_t differ = 0;
    int most = 0;
    for (std::size_t i = 0; i < a.rgba.size(); ++i) {
      const int by = std::abs(a.rgba[i] - b.rgba[i]);
      differ += by > 0 ? 1 : 0;
      most = std::max(most, by);
    }
    // The last bit of a value of which the card rounds the sum from another place.
    EXPECT_LE(most, 1) << name;
    EXPECT_LE(static_cast<double>(differ), 0.005 * static_cast<double>(a.rgba.size())) << name;
    EXPECT_EQ(whole.alpha.empty(), tiled.alpha.empty());
    ASSERT_EQ(whole.depth.size(), tiled.depth.size());
    for (std::size_t i = 0; i < whole.depth.size(); ++i)
      if (std::isinf(whole.depth[i]))
        ASSERT_TRUE(std::isinf(tiled.depth[i])) << name << " " << i;
      else
        // A card interpolates over a large cap a little differently from another corner.
        ASSERT_NEAR(whole.depth[i], tiled.depth[i], 1e-4f * whole.depth[i]) << name << " " << i;
    // Where a cap ends, a sample may be of the cap in one picture and of the surface in the other.
    std::size_t other = 0;
    for (std::size_t i = 0; i < whole.normals.size(); ++i)
      other += std::abs(whole.normals[i] - tiled.normals[i]) > 4e-3f ? 1 : 0;
    EXPECT_LE(static_cast<double>(other), 1e-3 * static_cast<double>(whole.normals.size())) << name;
  }

  test::TemporaryFolder folder_;
  std::unique_ptr<GlSceneRenderer> renderer_;
  std::shared_ptr<const Pyramid> pyramid_;
  std::unique_ptr<ViewSession> session_;
  ViewState plain_;
};

TEST_F(PictureTilesTest, ATiledPictureIsTheOneDrawnInOnePiece) {
  std::vector<std::pair<std::string, ViewState>> views{{"plain", plain_}};
  const auto add = [&](const char* name) -> ViewState& {
    return views.emplace_back(name, plain_).second;
  };
  add("near").camera.distance = 40.0;
  add("parallel").camera.orthographic = true;
  ViewState& occlusion = add("occlusion");
  occlusion.ambient_occlusion = true;
  occlusion.camera.distance = 50.0;
  add("shadow").shadow = true;
  ViewState& levels = add("levels");
  levels.focus.everywhere = false;
  levels.focus.show_sphere = true;
  levels.coloring = ViewColoring::kLevel;
  levels.wireframe = true;
  ViewState& cap = add("cap");
  cap.clip_planes = {{{-0.6, 0.8, 0.0}, 6.0, true, true}};
  ViewState& slices = add("slices");
  slices.slices = {{{true, 24.0}, {true, 30.0}, {true, 12.0}}};
  slices.slice_opacity = 0.6;
  ViewState& two = add("two");
  two.surfaces.push_back({180.0, {0.8f, 0.3f, 0.2f}, 1.0, true});
  two.surfaces[0].opacity = 0.4;
  two.pictures.transparent = true;
  ViewState& values = add("values");
  values.coloring = ViewColoring::kGradient;
  values.values.gradient_window = {{0.0, 16.0}};
  values.values.opacity = {0.2, 0.9};
  values.surfaces.push_back({180.0, {0.8f, 0.3f, 0.2f}, 1.0, true});
  ViewState& all = add("all");
  all.ambient_occlusion = all.shadow = true;
  all.clip_planes = {{{-0.6, 0.8, 0.0}, 6.0, true, true}};
  all.slices[2] = {true, 12.0};
  all.coloring = ViewColoring::kPlaneDistance;
  all.values.plane = {{0.0, 0.0, 1.0}, 23.5};
  all.pictures = {false, 1, true, true, true};
  all.measurements.push_back({});
  all.measurements.back().points = {{10.0, 10.0, 10.0}, {40.0, 30.0, 35.0}};
  for (const auto& [name, state] : views) expectTheSame(name, sceneOf(state, 331, 243));
}

// A picture so high that what is around a pixel is looked up in coarser depths: the margin of a
// tile is small again.
TEST_F(PictureTilesTest, LargePicturesShadeThemselvesAcrossTilesToo) {
  ViewState state = plain_;
  state.ambient_occlusion = true;
  state.camera.distance = 40.0;
  for (const bool orthographic : {false, true}) {
    state.camera.orthographic = orthographic;
    const SceneWithNotes scene = sceneOf(state, 151, 2143);
    EXPECT_LT(renderer_->neighbourhoodOf(scene.frame), 8);
    expectTheSame(orthographic ? "high-parallel" : "high", scene);
  }
}

// Passes say how far they look.
TEST_F(PictureTilesTest, WhatIsDrawnAroundATileFollowsFromThePasses) {
  SceneFrame frame;
  frame.width = 4000;
  frame.height = 1600;
  EXPECT_EQ(renderer_->neighbourhoodOf(frame), 0);
  frame.ambient_occlusion = true;
  EXPECT_GE(renderer_->neighbourhoodOf(frame), 1600 / 16 + 2);
  frame.normals = true;
  EXPECT_EQ(renderer_->neighbourhoodOf(frame), 0);
}

// The window's frame, and reading it back, are none of the tiles'.
TEST_F(PictureTilesTest, TheFrameOfTheWindowStaysWhileTilesAreDrawn) {
  SceneFrame window = sceneOf(plain_, 120, 90).frame;
  renderer_->draw(window);
  const std::vector<float> before = renderer_->picture().rgb;
  const auto distance = [&] {
    renderer_->askDistance({60.0, 45.0});
    for (;;)
      if (const auto answer = renderer_->takeDistance()) return answer->distance;
  };
  const auto hit = distance();
  ASSERT_TRUE(hit);
  ViewState turned = plain_;
  turned.camera.azimuth += 90.0;
  SceneFrame other = window;
  other.camera = placeCamera(turned.camera, 4.0 / 3.0);
  other.shadow = true;
  renderer_->drawTile(other, {10, 10, 40, 40}, true);
  EXPECT_EQ(renderer_->picture().rgb, before);
  EXPECT_EQ(distance(), hit);
  renderer_->endTiles();
  EXPECT_EQ(renderer_->picture().rgb, before);
}

// --------------------------------------------------------------------------------- the division

TEST(PictureTilesDivisionTest, EveryPixelIsDrawnOnceFromTheTop) {
  NullRenderer renderer;
  for (const auto& [width, height, side, pixels] :
       {std::array{1, 1, 1, 1}, std::array{100, 70, 64, 100 * 64}, std::array{101, 71, 10, 1},
        std::array{7, 300, 100, 1 << 20}, std::array{5000, 3, 64, 5000}}) {
    SceneWithNotes scene;
    scene.frame.width = width;
    scene.frame.height = height;
    PictureTiles tiles(renderer, scene, {side, pixels});
    int rows = 0;
    double share = 0.0;
    while (!tiles.done()) {
      const auto band = tiles.drawNext();
      EXPECT_GT(tiles.share(), share);
      share = tiles.share();
      if (!band) continue;
      EXPECT_EQ(band->width, width);
      EXPECT_LE(band->height, side);
      rows += band->height;
    }
    EXPECT_EQ(rows, height);
    EXPECT_EQ(share, 1.0);
  }
}

// A poster of any size takes the memory of a band.
TEST(PictureTilesDivisionTest, BandsAreBoundedUpToTheGreatestSize) {
  NullRenderer renderer;
  SceneWithNotes scene;
  scene.frame.width = kMostPictureSide;
  scene.frame.height = 64;
  PictureTiles tiles(renderer, scene);
  std::size_t most = 0;
  while (!tiles.done())
    if (const auto band = tiles.drawNext()) most = std::max(most, band->rgb.size() / 3);
  EXPECT_LE(most, std::size_t{8} << 20);
  scene.frame.width = kMostPictureSide + 1;
  EXPECT_THROW(PictureTiles(renderer, scene), Error);
  scene.frame.width = 0;
  EXPECT_THROW(PictureTiles(renderer, scene), Error);
}

// ------------------------------------------------------------------------------ written in bands

Image rowsOf(const Image& image, int first, int count) {
  const auto part = [&](const std::vector<float>& values, int each) {
    if (values.empty()) return std::vector<float>();
    const auto row = static_cast<std::ptrdiff_t>(each) * image.width;
    return std::vector<float>(values.begin() + first * row, values.begin() + (first + count) * row);
  };
  Image rows{image.width, count, part(image.rgb, 3)};
  rows.alpha = part(image.alpha, 1);
  rows.depth = part(image.depth, 1);
  rows.normals = part(image.normals, 3);
  return rows;
}

Image colorful(int width, int height, bool layers) {
  Image image{width, height, {}};
  const std::size_t pixels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  for (std::size_t i = 0; i < 3 * pixels; ++i)
    image.rgb.push_back(0.5f + 0.5f * std::sin(0.001f * static_cast<float>(i * i % 9973)));
  if (!layers) return image;
  for (std::size_t i = 0; i < pixels; ++i) {
    image.alpha.push_back(static_cast<float>(i % 17) / 16.0f);
    image.depth.push_back(static_cast<float>(i));
    for (int c = 0; c < 3; ++c) image.normals.push_back(0.1f * static_cast<float>(c));
  }
  return image;
}

// Several strips of PNG, and blocks of 16 rows of EXR that bands cut.
TEST(LargePictureTest, BandsGiveTheFileOfTheWholePicture) {
  for (const ImageFormat format : {ImageFormat::kPng, ImageFormat::kExr}) {
    for (const bool layers : {false, true}) {
      const Image image = colorful(700, 1300, layers);
      const std::vector<char> whole = encodeImage(format, image);
      for (const int band : {1, 7, 500}) {
        MemoryFile file;
        const auto encoder = makeBandEncoder(
            format, shapeOf(image), [&](const void* data, std::size_t bytes, std::uint64_t offset) {
              file.write(data, bytes, offset);
            });
        for (int row = 0; row < image.height; row += band)
          encoder->add(rowsOf(image, row, std::min(band, image.height - row)));
        encoder->finish();
        EXPECT_TRUE(file.take() == whole) << band << " " << layers;
      }
    }
  }
}

TEST(LargePictureTest, PngOfManyStripsHoldsTheScreenValues) {
  const test::TemporaryFolder folder;
  const Image image = colorful(900, 1700, false);
  writeImage(folder.file("a.png"), image);
  EXPECT_TRUE(test::readPng(folder.file("a.png"), 2000).rgba == test::bytesOf(image).rgba);
}

TEST(LargePictureTest, EveryFloatHasTheScreenValueOfTheCurve) {
  Image image{4096, 16, {}};
  for (int i = 0; i < 3 * 4096 * 16; ++i)
    image.rgb.push_back(static_cast<float>(i) / (3 * 4096 * 16 - 1));
  for (unsigned value = 1; value < 256; ++value) {  // beside each step
    float step = linearFromSrgb((static_cast<float>(value) - 0.5f) / 255.0f);
    for (int i = -3; i <= 3; ++i)
      image.rgb[7 * value + static_cast<unsigned>(i + 3)] = step + 1e-7f * static_cast<float>(i);
  }
  const test::TemporaryFolder folder;
  writeImage(folder.file("a.png"), image);
  const PictureBytes read = test::readPng(folder.file("a.png"), 4096);
  for (std::size_t i = 0; i < image.rgb.size(); ++i)
    ASSERT_EQ(read.rgba[4 * (i / 3) + i % 3], toSrgb8(image.rgb[i])) << image.rgb[i];
}

TEST(LargePictureTest, AWriterGivesTheFileItsNameAtTheEnd) {
  const test::TemporaryFolder folder;
  const Image image = colorful(300, 200, false);
  const std::string path = folder.file("a.png");
  {
    PictureWriter writer(path, shapeOf(image));
    for (int row = 0; row < 200; row += 50) {
      EXPECT_FALSE(std::filesystem::exists(path));
      writer.add(rowsOf(image, row, 50));
    }
    writer.wait();
    EXPECT_TRUE(writer.done());
  }
  const std::vector<char> whole = encodeImage(ImageFormat::kPng, image);
  EXPECT_EQ(test::readBytes(path), std::string(whole.begin(), whole.end()));
}

TEST(LargePictureTest, AWriterThatIsGivenUpLeavesNothing) {
  const test::TemporaryFolder folder;
  const Image image = colorful(300, 200, false);
  const auto isEmpty = [&] { return std::filesystem::is_empty(folder.path()); };
  for (const char* name : {"a.png", "a.exr"}) {
    {
      PictureWriter writer(folder.file(name), shapeOf(image));
      writer.add(rowsOf(image, 0, 50));
    }
    EXPECT_TRUE(isEmpty());
    PictureWriter writer(folder.file(name), shapeOf(image));
    writer.add(rowsOf(image, 0, 50));
    writer.giveUp();
    EXPECT_TRUE(isEmpty());
    EXPECT_THROW(writer.add(rowsOf(image, 50, 50)), Cancelled);
    EXPECT_THROW(writer.wait(), Cancelled);
    PictureWriter interrupted(folder.file(name), shapeOf(image));
    CancelFlag flag;
    flag.request();
    EXPECT_THROW(interrupted.wait(&flag), Cancelled);
    EXPECT_TRUE(isEmpty());
  }
  EXPECT_THROW(PictureWriter(folder.file("missing/a.png"), shapeOf(image)), Error);
}

}  // namespace
}  // namespace isobrick
