// A session without a window: input, surfaces, slices and meshes, with a renderer that draws
// nothing.
#include "isobrick/viewer/session/view_session.h"

#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <glm/geometric.hpp>
#include <set>
#include <thread>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/vertex_numbering.h"
#include "isobrick/viewer/state/view_file.h"
#include "tests/support/field_pyramid.h"
#include "tests/support/null_renderer.h"
#include "tests/support/random_numbers.h"

namespace isobrick {
namespace {

using Kind = InputEvent::Kind;

class ViewSessionTest : public ::testing::Test {
 protected:
  ViewSessionTest() {
    pyramid_ = test::openField(folder_, Index3(60), [](const glm::dvec3& p) {
      return 25.0 - glm::distance(p, glm::dvec3(30.0));
    });
    open(std::uint64_t{1} << 30);
  }

  void open(std::uint64_t budget) {
    session_.reset();
    session_ = std::make_unique<ViewSession>(pyramid_, renderer_, SessionOptions{2, budget});
    session_->apply(InputEvent::resized(200, 100), 0.0, false);
  }
  void frame(double seconds) {
    session_->update(clock_ += seconds);
    session_->draw();
    session_->noteDrawing(0.001);
  }
  // Frames, without input, until all is there.
  void settle() {
    do {
      frame(0.05);
      std::this_thread::yield();
    } while (!session_->settled());
    frame(0.0);
  }
  // The Home key, and all that it asks for.
  void goHome() {
    InputEvent home;
    home.kind = InputEvent::Kind::kKeyPress;
    home.key = Key::kHome;
    session_->apply(home, clock_, false);
    settle();
  }
  std::uint64_t trianglesOfAll() const {
    CountingSink sink;
    const SurfaceWish wish = wishOf(session_->state(), session_->volume(), 100.0);
    return extractIsosurface(*pyramid_, queryOf(wish, session_->volume(), 0, wish.radius), sink)
        .triangles;
  }
  std::uint64_t trianglesShown() const {
    std::uint64_t triangles = 0;
    for (const ChunkId id : renderer_.frame().chunks)
      triangles += renderer_.kept().at(id).triangles;
    return triangles;
  }

  test::TemporaryFolder folder_;
  std::shared_ptr<const Pyramid> pyramid_;
  NullRenderer renderer_;
  std::unique_ptr<ViewSession> session_;
  double clock_ = 0.0;
};

// Of the region's volume alone, and in samples of a preview.
TEST_F(ViewSessionTest, ARegionCutsAllSurfaces) {
  settle();
  const std::uint64_t whole = trianglesShown();
  SessionOptions options{2};
  options.region.half_spaces = {{{1, 0, 0}, 30}};
  options.first = "ball";
  session_ = std::make_unique<ViewSession>(pyramid_, renderer_, options);
  session_->apply(InputEvent::resized(200, 100), 0.0, false);
  settle();
  EXPECT_NEAR(static_cast<double>(trianglesShown()), static_cast<double>(whole) / 2,
              static_cast<double>(whole) / 20);
  OpenedVolume opened;
  opened.source = "ball";
  EXPECT_EQ(options.of(opened).region, options.region);
  opened.source = "another";
  EXPECT_TRUE(options.of(opened).region.isEverywhere());
  const ShownVolume preview(pyramid_, PreviewOf{2, Index3(119)}, {0.0});
  ViewState state = firstView(preview.volume(), 1.0);
  state.region = options.region;
  EXPECT_EQ(preview.queryOf(preview.wishOf(state, 100), 0, 1000).region.half_spaces[0].offset, 15);
}

// Bricks are reused from surface to surface, but not from region to region.
TEST_F(ViewSessionTest, ARegionIsAPartOfTheView) {
  session_->state().focus.everywhere = true;
  settle();
  const std::uint64_t whole = trianglesShown();
  const auto isAbout = [&](double share) {
    return std::abs(static_cast<double>(trianglesShown()) / static_cast<double>(whole) - share) <
           0.05;
  };
  ViewState cut = session_->state();
  cut.region.half_spaces = {{{1, 0, 0}, 30}, {{0, 1, 0}, 30}};
  session_->show(cut);
  settle();
  EXPECT_TRUE(isAbout(0.25)) << trianglesShown();
  cut.region.half_spaces.pop_back();
  session_->show(cut);
  settle();
  EXPECT_TRUE(isAbout(0.5)) << trianglesShown();
  EXPECT_EQ(session_->meshOrder("m.ply").query.region.half_spaces, cut.region.half_spaces);
  cut.region.masks = {{"organ.isb", {}}};
  session_->show(cut);
  settle();
  EXPECT_TRUE(isAbout(0.5));
  EXPECT_NE(session_->status().limited.find("organ.isb"), std::string::npos);
  EXPECT_THROW(session_->meshOrder("m.ply"), Error);
  session_->state().region = {};
  settle();
  EXPECT_EQ(trianglesShown(), whole);
}

TEST_F(ViewSessionTest, AMaskIsOpenBeforeTheView) {
  SessionOptions options{2};
  options.region.masks = {{"half.isb", 1.0}};
  options.masks["half.isb"] = std::make_shared<const Pyramid>(test::buildField(
      folder_, Index3(60), [](const glm::dvec3& p) { return p.x > 30.0; }, {}, {}, "half.isb"));
  session_ = std::make_unique<ViewSession>(pyramid_, renderer_, options);
  session_->apply(InputEvent::resized(200, 100), 0.0, false);
  settle();
  const std::uint64_t half = trianglesShown();
  EXPECT_EQ(session_->status().limited, "");
  session_->state().region = {};
  settle();
  EXPECT_NEAR(static_cast<double>(half), 0.5 * static_cast<double>(trianglesShown()),
              0.05 * static_cast<double>(trianglesShown()));
}

TEST_F(ViewSessionTest, OpensOnASurfaceInItsFrame) {
  const double isovalue = session_->state().surfaces[0].isovalue;
  EXPECT_GT(isovalue, session_->volume().least_value);
  EXPECT_LT(isovalue, session_->volume().greatest_value);
  settle();
  EXPECT_GT(trianglesShown(), 0u);
  EXPECT_EQ(trianglesShown(), trianglesOfAll());
  EXPECT_EQ(session_->status().doing, "ready");
  EXPECT_EQ(session_->status().triangles, trianglesShown());
  EXPECT_EQ(session_->status().surface_age, 0.0);
}

TEST_F(ViewSessionTest, DraggedIsovaluesEndWithTheLastAtItsFinest) {
  settle();
  for (int i = 0; i < 60; ++i) {
    session_->state().surfaces[0].isovalue = 1.0 + 0.2 * i;
    frame(0.016);
    EXPECT_NE(session_->status().doing, "ready");
  }
  settle();
  EXPECT_EQ(session_->state().surfaces[0].isovalue, 1.0 + 0.2 * 59);
  EXPECT_EQ(trianglesShown(), trianglesOfAll());
}

// The triangles that fit the time are spread over all of the surface, unless the user said where.
TEST_F(ViewSessionTest, WhileAHandMovesAWholeSurfaceIsOfOneLevel) {
  settle();
  const auto drag = [&] {
    std::size_t most_levels = 0;
    for (int i = 0; i < 12; ++i) {
      session_->state().surfaces[0].isovalue = 5.0 + 0.1 * i;
      const std::uint64_t passes = session_->status().passes;
      while (session_->status().passes == passes) {
        session_->update(clock_ += 1e-9);
        std::this_thread::yield();
      }
      // One that is as fine as wanted is coarser where bricks are not in memory.
      const SessionStatus status = session_->status();
      if (status.shown_radius < status.wanted_radius)
        most_levels = std::max(most_levels, status.levels.size());
      session_->draw();
      session_->noteDrawing(0.9);  // slowly
    }
    EXPECT_LT(session_->status().shown_radius, session_->status().wanted_radius);
    return most_levels;
  };
  ASSERT_TRUE(session_->state().focus.everywhere);
  EXPECT_EQ(drag(), 1u);
  EXPECT_GT(session_->status().levels[0].level, 0);
  settle();
  EXPECT_EQ(trianglesShown(), trianglesOfAll());
  session_->state().focus.everywhere = false;
  session_->state().focus.radius = 30.0;
  settle();
  EXPECT_GT(drag(), 1u);
}

// A ball of radius 3 has a hundredth of the area of one of radius 24: the first surface after a
// jump from one to the other is as coarse as that asks for, and not given up for its triangles.
TEST_F(ViewSessionTest, AJumpOfTheIsovalueIsPredicted) {
  settle();
  const auto jumpTo = [&](double isovalue) {
    session_->state().surfaces[0].isovalue = isovalue;
    const std::uint64_t passes = session_->status().passes;
    while (session_->status().passes == passes) {
      session_->update(clock_ += 1e-9);
      std::this_thread::yield();
    }
    return session_->status();
  };
  jumpTo(22.0);
  settle();
  const SessionStatus small = session_->status(), large = jumpTo(1.0);
  const double expected = session_->histogram().trianglesAt(1.0);
  EXPECT_NEAR(expected, static_cast<double>(trianglesOfAll()), 0.1 * expected);
  EXPECT_NEAR(expected / session_->histogram().trianglesAt(22.0), 64.0, 16.0);
  EXPECT_LE(large.shown_radius, std::max(SurfacePace::kLeastRadius, 0.25 * small.drag_radius));
  EXPECT_NEAR(session_->predictedTriangles(1.0), static_cast<double>(large.triangles),
              0.01 * static_cast<double>(large.triangles));
}

TEST_F(ViewSessionTest, WhileOneSurfaceIsDraggedTheOthersStayAsTheyAre) {
  ViewState& state = session_->state();
  state.focus.everywhere = false;
  state.focus.radius = 40.0;
  state.surfaces.push_back(state.surfaces[0]);
  state.surfaces[1].isovalue = 5.0;
  settle();
  const auto chunksOf = [&](int surface) {
    std::vector<ChunkId> chunks;
    for (const ChunkId id : renderer_.frame().chunks)
      if (renderer_.kept().at(id).surface == surface) chunks.push_back(id);
    return chunks;
  };
  const std::vector<ChunkId> still = chunksOf(1), dragged = chunksOf(0);
  ASSERT_FALSE(still.empty());
  for (int i = 0; i < 20; ++i) {
    state.surfaces[0].isovalue = 10.0 + 0.1 * i;
    frame(0.016);
    std::this_thread::yield();
    EXPECT_EQ(chunksOf(1), still);
  }
  settle();
  EXPECT_EQ(chunksOf(1), still);
  EXPECT_NE(chunksOf(0), dragged);
  EXPECT_EQ(session_->status().triangles, trianglesShown());
  // What is not the same any longer is made anew: another place, another value, and back at once.
  state.focus.center.x += 1.0;
  settle();
  EXPECT_NE(chunksOf(1), still);
  for (const double isovalue : {7.0, 5.0, 7.0, 5.0, 8.0}) {
    state.surfaces[1].isovalue = isovalue;
    frame(0.01);
  }
  state.surfaces[0].isovalue += 1.0;
  settle();
  const std::uint64_t first = trianglesOfAll();
  std::swap(state.surfaces[0], state.surfaces[1]);
  const std::uint64_t second = trianglesOfAll();
  std::swap(state.surfaces[0], state.surfaces[1]);
  EXPECT_EQ(trianglesShown(), first + second);
  EXPECT_EQ(session_->status().triangles, trianglesShown());
}

TEST_F(ViewSessionTest, ColoursOfValuesSayWhatTheyStandFor) {
  settle();
  EXPECT_FALSE(session_->valueWindow());
  const std::vector<ChunkId> plain = renderer_.frame().chunks;
  ViewState& state = session_->state();
  state.coloring = ViewColoring::kGradient;
  settle();
  EXPECT_NE(renderer_.frame().chunks, plain);
  const auto [least, greatest] = session_->valueRange();
  EXPECT_EQ(*session_->valueWindow(), (std::array<double, 2>{0.0, 0.25 * greatest}));
  EXPECT_EQ(renderer_.frame().value_window, (std::array<double, 2>{0.0, 0.25}));
  // Another window extracts nothing.
  const std::vector<ChunkId> steep = renderer_.frame().chunks;
  state.values.gradient_window = {{0.5 * greatest, greatest}};
  settle();
  EXPECT_EQ(renderer_.frame().value_window, (std::array<double, 2>{0.5, 1.0}));
  EXPECT_EQ(renderer_.frame().chunks, steep);
  // One that is not there is an error in the window, and what was shown stays.
  state.coloring = ViewColoring::kOther;
  settle();
  state.values.other = folder_.file("nowhere.isb");
  settle();
  EXPECT_NE(session_->status().error.find("nowhere.isb"), std::string::npos);
  EXPECT_FALSE(renderer_.frame().chunks.empty());
  state.values.other = pyramid_->path();
  settle();
  EXPECT_EQ(session_->status().error, "");
  EXPECT_EQ(session_->valueRange(), (std::array<double, 2>{session_->volume().least_value,
                                                           session_->volume().greatest_value}));
}

TEST_F(ViewSessionTest, DistancesToAPlaneNeedNoExtraction) {
  settle();
  const std::vector<ChunkId> plain = renderer_.frame().chunks;
  ViewState& state = session_->state();
  state.coloring = ViewColoring::kPlaneDistance;
  state.values.plane = {{0.0, 0.0, 2.0}, 3.0};  // its normal becomes a unit
  state.values.map = ColorMap::kCoolWarm;
  settle();
  EXPECT_EQ(renderer_.frame().chunks, plain);
  const WorldBox box = session_->volume().box();
  const std::array<double, 2> all{box.lower.z - 3.0, box.upper.z - 3.0};
  EXPECT_EQ(session_->valueRange(), all);
  EXPECT_EQ(renderer_.frame().value_window, all);
  EXPECT_EQ(renderer_.frame().value_plane->normal, glm::dvec3(0.0, 0.0, 1.0));
  EXPECT_EQ(renderer_.frame().color_map, ColorMap::kCoolWarm);
  state.values.plane_window = {{-1.0, 1.5}};
  settle();
  EXPECT_EQ(renderer_.frame().value_window, (std::array<double, 2>{-1.0, 1.5}));
  state.coloring = ViewColoring::kPlain;
  settle();
  EXPECT_FALSE(renderer_.frame().value_window || renderer_.frame().value_plane);
}

TEST_F(ViewSessionTest, ACardShadesHollowsFromTheFirstPictureOn) {
  EXPECT_FALSE(session_->state().ambient_occlusion);
  renderer_.is_software = false;
  open(std::uint64_t{1} << 30);
  settle();
  EXPECT_TRUE(renderer_.frame().ambient_occlusion);
}

// And the steps go on with the volume that follows it.
TEST_F(ViewSessionTest, APreviewHasItsUndo) {
  session_ = std::make_unique<ViewSession>(
      pyramid_, renderer_, SessionOptions{2, std::uint64_t{1} << 30, PreviewOf{2, Index3(119)}});
  session_->apply(InputEvent::resized(200, 100), 0.0, false);
  const auto key = [&](Key pressed, bool control) {
    InputEvent event;
    event.kind = Kind::kKeyPress;
    event.key = pressed;
    event.control = control;
    session_->apply(event, clock_, false);
    for (int i = 0; i < 4; ++i) frame(0.3);
  };
  settle();
  key(Key::kX, false);
  key(Key::kB, false);
  ASSERT_EQ(session_->state().clip_planes.size(), 1u);
  key(Key::kZ, true);
  EXPECT_EQ(session_->state().clip_planes.size(), 1u);  // the box alone is undone
  EXPECT_FALSE(session_->state().show_box);
  const auto preview = std::move(session_);
  open(std::uint64_t{1} << 30);
  session_->follow(*preview);
  settle();
  const ViewCamera camera = session_->state().camera;
  key(Key::kZ, true);
  EXPECT_TRUE(session_->state().clip_planes.empty());
  EXPECT_EQ(session_->state().camera, camera);  // the volume's framing is no step
}

// Home frames the surface, if another view came first.
TEST_F(ViewSessionTest, HomeAfterASavedViewIsTheViewOfTheVolume) {
  settle();
  const ViewState first = session_->state();
  open(std::uint64_t{1} << 30);
  ViewState saved = first;
  saved.camera = orbited(saved.camera, 70.0, 10.0);
  saved.wireframe = true;
  session_->show(saved);
  settle();
  EXPECT_EQ(session_->state(), saved);
  goHome();
  EXPECT_EQ(session_->state(), first);
}

// From its direction, if it says one.
TEST_F(ViewSessionTest, ASavedViewThatSaysNoDistanceIsFramedOnItsSurface) {
  settle();
  const ViewState first = session_->state();
  session_->show(viewStateFromJson(R"({"camera": {"azimuth": 70}, "surfaces": [{"isovalue": 20}],
                                      "focus": {"everywhere": true}})"));
  settle();
  ViewCamera wanted = first.camera;
  wanted.azimuth = 70.0;
  wanted = framed(wanted, WorldBox{glm::dvec3(25.0), glm::dvec3(35.0)}, 2.0);
  EXPECT_NEAR(session_->state().camera.distance, wanted.distance, 0.1 * wanted.distance);
  EXPECT_EQ(session_->state().camera.azimuth, 70.0);
  EXPECT_LT(glm::distance(session_->state().camera.pivot, wanted.pivot), 1.0);
  goHome();
  EXPECT_EQ(session_->state(), first);
}

TEST_F(ViewSessionTest, TurningTheCameraAsksForNothing) {
  settle();
  const std::uint64_t passes = session_->status().passes, uploaded = renderer_.uploadedBytes();
  for (int i = 0; i < 30; ++i) {
    session_->state().camera = orbited(session_->state().camera, 5.0, 1.0);
    frame(0.016);
  }
  settle();
  EXPECT_EQ(session_->status().passes, passes);
  EXPECT_EQ(renderer_.uploadedBytes(), uploaded);
}

TEST_F(ViewSessionTest, WhatANewSurfaceTookIsTold) {
  settle();
  frame(0.01);
  EXPECT_TRUE(session_->waits().empty());
  session_->state().surfaces[0].isovalue += 1.0;
  // The caller's time runs faster than that of the extraction.
  const double begin = clock_ + 10.0;
  do {
    frame(10.0);
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  } while (session_->waits().empty());
  const SurfaceWait wait = session_->waits().front();
  EXPECT_NEAR(wait.total(), clock_ - begin, 1e-6);
  EXPECT_EQ(wait.extraction > 0.0, wait.total() > 0.0);
}

TEST_F(ViewSessionTest, WhatDrawsSlowlyIsNotDrawnOnceMoreJustBeforeItGoes) {
  const auto drawAnother = [&](double seconds) {
    session_->state().wireframe = !session_->state().wireframe;
    ASSERT_TRUE(session_->draw());
    session_->noteDrawing(seconds);
  };
  settle();
  drawAnother(0.5);
  EXPECT_FALSE(session_->drawsBetterLater());  // it stays
  const auto change = [&] {
    session_->state().surfaces[0].isovalue += 1.0;
    const std::uint64_t passes = session_->status().passes;
    session_->update(clock_ += 0.01);
    return session_->status().passes == passes;  // it is not there at once
  };
  const bool lacks = change();
  EXPECT_EQ(session_->drawsBetterLater(), lacks);
  session_->update(clock_ += 0.2);  // nor is it waited for that long
  EXPECT_FALSE(session_->drawsBetterLater());
  settle();
  drawAnother(0.01);  // what is fast is drawn
  change();
  EXPECT_FALSE(session_->drawsBetterLater());
}

TEST_F(ViewSessionTest, ADoubleClickFocusesOnWhatIsHit) {
  settle();
  const PlacedCamera camera = placeCamera(session_->state().camera, 2.0);
  renderer_.distance = 20.0;
  const auto click = [&] {
    InputEvent event;
    event.x = 100.0;
    event.y = 50.0;
    event.kind = Kind::kMove;
    session_->apply(event, clock_, false);
    for (int i = 0; i < 2; ++i) {
      for (const Kind kind : {Kind::kPress, Kind::kRelease}) {
        event.kind = kind;
        session_->apply(event, clock_, false);
      }
    }
  };
  click();
  // The middle of the pixel, which is half a pixel beside the middle of the picture.
  const glm::dvec3 hit = rayThrough(camera, {0.005, -0.01}).at(20.0);
  EXPECT_LT(glm::distance(session_->state().camera.pivot, hit), 1e-9);
  // Nothing hit: nothing happens.
  renderer_.distance.reset();
  const ViewState before = session_->state();
  click();
  EXPECT_EQ(session_->state(), before);
  settle();
}

// A preview's samples are further apart than the volume's.
TEST_F(ViewSessionTest, WhatIsShownOfAPreviewIsFramed) {
  session_.reset();
  session_ = std::make_unique<ViewSession>(
      pyramid_, renderer_, SessionOptions{2, std::uint64_t{1} << 30, PreviewOf{2, Index3(119)}});
  session_->apply(InputEvent::resized(200, 100), 0.0, false);
  session_->state().surfaces[0].isovalue = 15.0;  // a sphere of 10 samples around (30, 30, 30)
  settle();
  EXPECT_LT(glm::distance(session_->state().camera.pivot, session_->volume().box().center()), 1e-9);
  InputEvent event;
  event.kind = Kind::kKeyPress;
  event.key = Key::kF;
  session_->apply(event, clock_, false);
  const double spacing = session_->volume().geometry.spacing.x;
  EXPECT_LT(glm::distance(session_->state().camera.pivot, spacing * glm::dvec3(60.0)), spacing);
}

TEST_F(ViewSessionTest, WhatTheBudgetHoldsIsShownAndSaid) {
  open(150'000);
  session_->keepFocus();
  settle();
  const SessionStatus status = session_->status();
  EXPECT_NE(status.limited.find("GPU budget reached"), std::string::npos) << status.limited;
  EXPECT_LT(status.shown_radius, status.wanted_radius);
  EXPECT_LE(renderer_.bytesKept(), 150'000u);
  EXPECT_GT(trianglesShown(), 0u);
}

// Two sessions with one budget: what the first one gives back makes the other one finer.
TEST_F(ViewSessionTest, ABudgetIsSharedAndRoomThatComesBackIsUsed) {
  settle();
  const std::uint64_t whole = renderer_.bytesKept();
  const SessionOptions shared{2, 2 * whole - 1};
  session_ = std::make_unique<ViewSession>(pyramid_, renderer_, shared);
  session_->apply(InputEvent::resized(200, 100), 0.0, false);
  settle();
  const auto first = std::move(session_);
  session_ = std::make_unique<ViewSession>(pyramid_, renderer_, shared);
  session_->apply(InputEvent::resized(200, 100), 0.0, false);
  session_->keepFocus();
  settle();
  EXPECT_TRUE(session_->isOverBudget());
  EXPECT_LT(renderer_.bytesKept(), 2 * whole);
  first->suspend();
  settle();
  EXPECT_FALSE(session_->isOverBudget());
  EXPECT_EQ(trianglesShown(), trianglesOfAll());
}

TEST_F(ViewSessionTest, WhereThePassForAHandDoesNotFitACoarserOneIsShown) {
  open(std::uint64_t{1} << 30);
  session_->state().focus.everywhere = false;
  session_->state().focus.radius = 1.0;
  settle();
  // What is shown and what comes in fit just so.
  const std::uint64_t least = renderer_.bytesKept();
  open(3 * least);
  session_->keepFocus();
  settle();
  session_->state().surfaces[0].isovalue += 0.25;
  settle();
  EXPECT_GT(trianglesShown(), 0u);
  EXPECT_LE(renderer_.bytesKept(), 3 * least);
  EXPECT_LT(session_->status().shown_radius, 16.0);
  EXPECT_NE(session_->status().limited.find("showing radius"), std::string::npos)
      << session_->status().limited;
  open(least / 2);
  session_->keepFocus();
  session_->state().focus.everywhere = false;  // of all of the surface, a level would fit
  settle();
  EXPECT_EQ(trianglesShown(), 0u);
  EXPECT_NE(session_->status().limited.find("not even the coarsest"), std::string::npos)
      << session_->status().limited;
}

// A card without memory for what the budget allows.
class FullRenderer : public NullRenderer {
 public:
  ChunkId reserve(const SurfaceChunk& chunk) override {
    if (is_lost) throw RendererLost();
    if (bytesKept() + chunk.bytes() > room) throw NoGraphicsMemory("no memory left");
    return NullRenderer::reserve(chunk);
  }
  std::uint64_t room = 0;
  bool is_lost = false;
};

TEST_F(ViewSessionTest, ACardThatIsFullShowsACoarserSurface) {
  settle();
  FullRenderer full;
  full.room = renderer_.bytesKept();
  session_ = std::make_unique<ViewSession>(pyramid_, full, SessionOptions{2, 1 << 30});
  session_->keepFocus();
  do {
    session_->update(clock_ += 0.05);
    std::this_thread::yield();
  } while (!session_->settled());
  EXPECT_GT(session_->status().triangles, 0u);
  EXPECT_GT(full.kept().size(), 0u);
  EXPECT_LT(session_->status().shown_radius, session_->status().wanted_radius);
  EXPECT_NE(session_->status().limited.find("GPU budget reached"), std::string::npos);
  // Another program gave its memory back.
  full.room = std::uint64_t{1} << 30;
  session_->state().surfaces[0].isovalue += 0.5;
  do {
    session_->update(clock_ += 0.05);
    std::this_thread::yield();
  } while (!session_->settled());
  EXPECT_EQ(session_->status().limited, "");
  EXPECT_EQ(session_->status().shown_radius, session_->status().wanted_radius);
  session_.reset();
}

// A loss is no want of memory: the owner is told, makes another renderer, and all is there again.
TEST_F(ViewSessionTest, ALossWithinAFrameIsTold) {
  FullRenderer card;
  card.room = std::uint64_t{1} << 30;
  card.is_lost = true;
  session_ = std::make_unique<ViewSession>(pyramid_, card, SessionOptions{2, 1 << 30});
  EXPECT_THROW(
      for (int i = 0; i < 100'000; ++i) {
        session_->update(clock_ += 0.05);
        std::this_thread::yield();
      },
      RendererLost);
  session_->suspend();
  session_->resume(renderer_);
  session_->apply(InputEvent::resized(200, 100), clock_, false);
  settle();
  EXPECT_EQ(trianglesShown(), trianglesOfAll());
}

TEST_F(ViewSessionTest, WhatARendererLostIsMadeAgainInAnother) {
  session_->state().slices[1].shown = true;
  settle();
  const std::uint64_t triangles = trianglesShown();
  const std::size_t slices = renderer_.frame().slices.size();
  ASSERT_EQ(slices, 1u);
  for (const bool in_the_middle : {false, true}) {
    if (in_the_middle) {
      session_->state().surfaces[0].isovalue += 1.0;
      frame(0.02);
    }
    session_->suspend();
    EXPECT_TRUE(renderer_.kept().empty());
    renderer_ = NullRenderer();
    session_->resume(renderer_);
    settle();
    EXPECT_EQ(renderer_.frame().slices.size(), slices);
    EXPECT_EQ(trianglesShown(), trianglesOfAll());
    if (!in_the_middle) {
      EXPECT_EQ(trianglesShown(), triangles);
    }
  }
}

// The first surface after a loss is bounded by what was drawn slowly before, and is not the last.
TEST_F(ViewSessionTest, WhatWasGivenUpAfterALossBecomesFineAfterARest) {
  settle();
  session_->state().wireframe = true;
  ASSERT_TRUE(session_->draw());
  session_->noteDrawing(1.0);
  session_->suspend();
  renderer_ = NullRenderer();
  session_->resume(renderer_);
  settle();
  EXPECT_EQ(trianglesShown(), trianglesOfAll());
}

TEST_F(ViewSessionTest, SlicesAndCapsComeAndGo) {
  ViewState& state = session_->state();
  state.slices[0] = {true, 12.0};
  toggleClipPlane(2, session_->volume(), state);
  settle();
  ASSERT_EQ(renderer_.frame().slices.size(), 2u);
  EXPECT_FALSE(renderer_.frame().slices[0].least_value);
  EXPECT_EQ(renderer_.frame().slices[1].cap_of, 0);
  EXPECT_EQ(renderer_.frame().slices[1].least_value, state.surfaces[0].isovalue);
  EXPECT_FALSE(renderer_.frame().slices[1].below_value);
  EXPECT_EQ(renderer_.frame().clip_planes.size(), 1u);
  state.surfaces[0].inside = InsideOf::kBelow;
  settle();
  EXPECT_FALSE(renderer_.frame().slices[1].least_value);
  EXPECT_EQ(renderer_.frame().slices[1].below_value, state.surfaces[0].isovalue);
  const SliceId first = renderer_.frame().slices[0].image;
  state.slices[0].shown = false;
  state.clip_planes[0].enabled = false;
  settle();
  EXPECT_TRUE(renderer_.frame().slices.empty());
  EXPECT_EQ(std::count(renderer_.releasedSlices().begin(), renderer_.releasedSlices().end(), first),
            1);
}

// Slices and caps are uploads of a frame like all others: rows of them wait where it has no room.
TEST_F(ViewSessionTest, SlicesCountAmongTheUploadsOfAFrame) {
  settle();
  for (ViewSlice& slice : session_->state().slices) slice.shown = true;
  const auto updateWith = [&](std::uint64_t bytes) {
    UploadAllowance allowance;
    allowance.bytes = bytes;
    const std::uint64_t before = renderer_.uploadedBytes();
    session_->update(clock_ += 0.05, allowance);
    EXPECT_EQ(renderer_.uploadedBytes() - before, bytes - allowance.bytes);
    session_->draw();
    return bytes - allowance.bytes;
  };
  for (int i = 0; i < 20; ++i) {
    EXPECT_EQ(updateWith(60 * sizeof(float) - 1), 0u);
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  EXPECT_FALSE(session_->settled());
  EXPECT_TRUE(renderer_.frame().slices.empty());
  int frames = 0;
  for (; !session_->settled(); ++frames) EXPECT_LE(updateWith(4096), 4096u);
  updateWith(kUploadBytes);
  EXPECT_EQ(renderer_.frame().slices.size(), 3u);
  EXPECT_GE(frames, 3 * 4);  // 17 rows of 60 fit in a frame
}

TEST_F(ViewSessionTest, TheMeshOfWhatIsShownIsWritten) {
  MeshQueue queue(2);
  const auto ended = [&] {
    std::optional<MeshQueue::Outcome> outcome;
    while (!(outcome = queue.poll())) std::this_thread::yield();
    return *outcome;
  };
  const std::string path = folder_.file("shown.stl"), jpg = folder_.file("shown.jpg");
  queue.add(session_->meshOrder(path));
  EXPECT_EQ(ended().error, "");
  EXPECT_EQ(std::filesystem::file_size(path), 84 + 50 * trianglesOfAll());
  queue.add(session_->meshOrder(jpg));
  EXPECT_NE(ended().error.find("shown.jpg"), std::string::npos);
  EXPECT_EQ(queue.unwritten(), 0u);
}

// Neither a further order nor the end of the session that gave it ends one.
TEST_F(ViewSessionTest, AMeshOfAPreviewKeepsTheDistanceInVoxelsOfTheVolume) {
  session_->state().mesh_distance = 1.5;
  EXPECT_EQ(session_->meshOrder("a.ply").query.simplify->distance, 1.5);
  session_ = std::make_unique<ViewSession>(
      pyramid_, renderer_, SessionOptions{2, std::uint64_t{1} << 30, PreviewOf{4, Index3(237)}});
  session_->state().mesh_distance = 1.5;
  EXPECT_EQ(session_->meshOrder("a.ply").query.simplify->distance, 1.5 / 4.0);
}

TEST_F(ViewSessionTest, EveryOrderedMeshIsWritten) {
  MeshQueue queue(2);
  std::vector<std::string> paths;
  for (const char* name : {"a.stl", "b.stl", "c.stl"}) {
    paths.push_back(folder_.file(name));
    session_->state().surfaces[0].isovalue += 1.0;
    queue.add(session_->meshOrder(paths.back()));
  }
  EXPECT_EQ(queue.unwritten(), 3u);
  EXPECT_EQ(queue.underWay(), paths[0]);
  EXPECT_TRUE(queue.willWrite(paths[2]));
  session_.reset();
  std::vector<std::string> written;
  while (queue.unwritten() > 0)
    if (const auto ended = queue.poll()) written.push_back(ended->error + ended->path);
  EXPECT_EQ(written, paths);
  EXPECT_FALSE(queue.willWrite(paths[2]));
  for (const std::string& path : paths) EXPECT_GT(std::filesystem::file_size(path), 84u);
}

// Each frame moves the slice, faster than it is sampled.
TEST_F(ViewSessionTest, SlicesFollowWhileTheyAreDragged) {
  ViewState& state = session_->state();
  for (ViewSlice& slice : state.slices) slice.shown = true;
  settle();
  const auto imageOf = [&](std::size_t slice) { return renderer_.frame().slices.at(slice).image; };
  const SliceId still = imageOf(1);
  std::set<SliceId> images;
  for (int i = 0; images.size() < 5; ++i) {
    ASSERT_LT(i, 100'000);
    state.slices[0].position = 5.0 + 0.001 * (i % 50'000);
    frame(0.001);
    EXPECT_EQ(imageOf(1), still);  // unchanged, so kept
    images.insert(imageOf(0));
    std::this_thread::yield();
  }
  settle();
  EXPECT_EQ(imageOf(1), still);
  EXPECT_EQ(renderer_.slices().size(), 3u);
}

// Divided by its length once more, such a normal is another one.
TEST_F(ViewSessionTest, AnyClipPlaneComesToRest) {
  test::Random random(7);
  for (int i = 0; i < 30; ++i) {
    ViewClipPlane plane;
    for (int axis = 0; axis < 3; ++axis)
      plane.normal[axis] = static_cast<double>(test::randomInt(random, -9, 9));
    if (i == 0) plane.normal = {7.0, 7.0, 8.0};
    plane.offset = glm::dot(plane.normal, glm::dvec3(30.0)) / glm::length(plane.normal);
    session_->state().clip_planes = {plane};
    for (int frames = 0; frames < 4000 && (frames < 3 || !session_->settled()); ++frames) {
      frame(0.05);
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    for (int more = 0; more < 3; ++more) {
      ASSERT_TRUE(session_->settled()) << "normal " << plane.normal.x << " " << plane.normal.y;
      frame(0.05);
    }
  }
}

TEST_F(ViewSessionTest, ACapNeverLiesBesideItsCut) {
  ViewState& state = session_->state();
  toggleClipPlane(2, session_->volume(), state);
  toggleClipPlane(0, session_->volume(), state);
  settle();
  ASSERT_EQ(renderer_.frame().slices.size(), 2u);
  const SliceId still = renderer_.frame().slices[1].image;
  for (int i = 0; i < 30; ++i) {
    state.clip_planes[0].offset += 0.25;
    frame(0.01);
    for (const SceneSlice& cap : renderer_.frame().slices) {
      const SceneClipPlane& cut =
          renderer_.frame().clip_planes.at(static_cast<std::size_t>(cap.cap_of));
      EXPECT_NEAR(glm::dot(cut.normal, cap.corner), cut.offset, 1e-9);
    }
    EXPECT_EQ(renderer_.frame().slices.back().image, still);
  }
  // It is numbered anew, and is the same all the same.
  state.clip_planes[0].enabled = false;
  settle();
  ASSERT_EQ(renderer_.frame().slices.size(), 1u);
  EXPECT_EQ(renderer_.frame().slices[0].cap_of, 0);
  EXPECT_EQ(renderer_.frame().slices[0].image, still);
}

TEST_F(ViewSessionTest, DepthIsReadAtRestOnceForAPlace) {
  settle();
  renderer_.distance = 20.0;
  ASSERT_TRUE(session_->surfaceUnderCursor());
  const std::uint64_t read = renderer_.distancesRead();
  for (int i = 0; i < 5; ++i) {
    frame(0.1);
    EXPECT_TRUE(session_->surfaceUnderCursor());
  }
  EXPECT_EQ(renderer_.distancesRead(), read);
  for (int i = 0; i < 5; ++i) {
    session_->state().camera = orbited(session_->state().camera, 5.0, 1.0);
    EXPECT_FALSE(session_->surfaceUnderCursor());
    frame(0.1);
  }
  EXPECT_EQ(renderer_.distancesRead(), read);
  EXPECT_TRUE(session_->surfaceUnderCursor());
  EXPECT_EQ(renderer_.distancesRead(), read + 1);
}

// No frame waits for a depth. A press hits what the user saw, by the camera that drew it, even if
// the answer comes when another frame is there.
TEST_F(ViewSessionTest, APlaceIsThatOfTheFrameThatWasDrawnAndMayComeLater) {
  settle();
  renderer_.distance = 20.0;
  const ViewCamera first = session_->state().camera;
  const glm::dvec3 hit = rayThrough(placeCamera(first, 2.0), {0.005, -0.01}).at(20.0);
  InputEvent event;
  event.x = 100.0;
  event.y = 50.0;
  event.kind = Kind::kMove;
  session_->apply(event, clock_, false);
  renderer_.answers_late = true;
  for (int i = 0; i < 2; ++i)
    for (const Kind kind : {Kind::kPress, Kind::kRelease}) {
      event.kind = kind;
      session_->apply(event, clock_, false);
    }
  for (int i = 0; i < 5; ++i) {
    session_->state().camera = orbited(session_->state().camera, 5.0, 1.0);
    frame(0.1);
  }
  EXPECT_EQ(session_->state().camera.pivot, first.pivot);
  EXPECT_FALSE(session_->settled());  // scripts wait for it
  renderer_.answers_late = false;
  frame(0.1);
  EXPECT_LT(glm::distance(session_->state().camera.pivot, hit), 1e-9);
  settle();
}

// A screen of another scale has cursors between its pixels, and depths in their middles.
TEST_F(ViewSessionTest, APlaceBetweenTwoPixelsIsThatOfItsPixel) {
  settle();
  renderer_.distance = 20.0;
  const glm::dvec3 hit =
      rayThrough(placeCamera(session_->state().camera, 2.0), {0.005, -0.01}).at(20.0);
  InputEvent event;
  event.x = 100.75;
  event.y = 50.9;
  event.kind = Kind::kMove;
  session_->apply(event, clock_, false);
  frame(0.1);
  const auto point = session_->surfaceUnderCursor();
  ASSERT_TRUE(point);
  EXPECT_LT(glm::distance(*point, hit), 1e-9);
}

// Until a depth is there the line at the foot has the last one of the same frame.
TEST_F(ViewSessionTest, UnderTheCursorIsWhatWasReadLast) {
  settle();
  renderer_.distance = 20.0;
  const auto before = session_->surfaceUnderCursor();
  ASSERT_TRUE(before);
  renderer_.answers_late = true;
  const std::uint64_t read = renderer_.distancesRead();
  InputEvent move;
  move.kind = Kind::kMove;
  for (int i = 0; i < 5; ++i) {
    move.x = 60.0 + i;
    move.y = 40.0;
    session_->apply(move, clock_, false);
    EXPECT_EQ(session_->surfaceUnderCursor(), before);
  }
  EXPECT_EQ(renderer_.distancesRead(), read + 1);  // one at a time
  renderer_.answers_late = false;
  session_->surfaceUnderCursor();
  session_->surfaceUnderCursor();
  const auto after = session_->surfaceUnderCursor();
  ASSERT_TRUE(after);
  EXPECT_NE(*after, *before);
  EXPECT_EQ(renderer_.distancesRead(), read + 2);
}

// As fine as a picture can show: another picture shows more.
TEST_F(ViewSessionTest, AResizeAsksAnewIfTheViewSaysHowFine) {
  session_->state().view_pixels = 6.0;
  session_->keepFocus();
  settle();
  const std::uint64_t small = trianglesShown();
  session_->apply(InputEvent::resized(1600, 800), clock_, false);
  EXPECT_FALSE(session_->settled());
  settle();
  EXPECT_GT(trianglesShown(), small);
}

TEST_F(ViewSessionTest, AFileThatIsCutWhileItIsOpenIsAnErrorInTheWindow) {
  settle();
  const std::vector<ChunkId> before = renderer_.frame().chunks;
  std::filesystem::resize_file(pyramid_->path(), std::filesystem::file_size(pyramid_->path()) / 4);
  session_->keepFocus();
  session_->state().surfaces[0].isovalue = 17.25;
  settle();
  EXPECT_NE(session_->status().error.find(pyramid_->path()), std::string::npos)
      << session_->status().error;
  // The surface shown stays, and input is still taken.
  EXPECT_EQ(renderer_.frame().chunks, before);
  session_->state().camera = orbited(session_->state().camera, 10.0, 0.0);
  frame(0.1);
  EXPECT_EQ(renderer_.frame().chunks, before);
}

// Panels move over a scene that stays as it is.
TEST_F(ViewSessionTest, AFrameThatIsTheSameIsNotDrawnAgain) {
  settle();
  const auto drawsOf = [&](auto&& change) {
    const std::uint64_t before = renderer_.draws();
    change();
    for (int i = 0; i < 10; ++i) frame(0.02);
    return renderer_.draws() - before;
  };
  InputEvent move;
  move.kind = Kind::kMove;
  const auto moveTo = [&](double x) {
    move.x = x;
    session_->apply(move, clock_, true);
  };
  ViewState& state = session_->state();
  EXPECT_EQ(drawsOf([&] { moveTo(5.0); }), 0u);
  EXPECT_EQ(drawsOf([&] { state.mesh_distance = 1.0; }), 0u);  // of files alone
  EXPECT_EQ(drawsOf([&] { state.camera = orbited(state.camera, 5.0, 1.0); }), 1u);
  EXPECT_EQ(drawsOf([&] { state.surfaces[0].color.r = 0.5f; }), 1u);
  EXPECT_EQ(drawsOf([&] {
              state.clip_planes.push_back({{1.0, 0.0, 0.0}, 30.0, true, false});
            }),
            1u);
  EXPECT_EQ(drawsOf([&] { session_->pictureFrame(50, 50); }), 0u);  // a tile is another memory's
  EXPECT_EQ(drawsOf([&] { session_->suspend(), session_->resume(renderer_); }) > 0, true);
  settle();
  EXPECT_EQ(drawsOf([&] { moveTo(6.0); }), 0u);
  EXPECT_FALSE(session_->draw());
  session_->noteDrawing(5.0);  // of a panel: it says nothing of the scene
  EXPECT_FALSE(session_->drawsBetterLater());
}

TEST_F(ViewSessionTest, WithoutASizeNothingIsDrawn) {
  session_->apply(InputEvent::resized(0, 0), 0.0, false);
  session_->update(1.0);
  EXPECT_FALSE(session_->draw());
  EXPECT_EQ(renderer_.draws(), 0u);
}

TEST_F(ViewSessionTest, EverythingThatWasKeptIsReleased) {
  session_->state().slices[1].shown = true;
  settle();
  EXPECT_FALSE(renderer_.kept().empty());
  session_.reset();
  EXPECT_TRUE(renderer_.kept().empty());
  EXPECT_FALSE(renderer_.releasedSlices().empty());
}

}  // namespace
}  // namespace isobrick
