// Surfaces coloured by their pieces in a session without a window.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <glm/geometric.hpp>
#include <limits>
#include <map>
#include <set>
#include <thread>

#include "isobrick/viewer/session/view_session.h"
#include "tests/extract/random_case.h"
#include "tests/support/keeping_renderer.h"
#include "tests/support/two_balls.h"

namespace isobrick {
namespace {

using test::kLarge;
using test::kLargeRadius;
using test::kSmall;
using test::kSmallRadius;

class SessionColorsTest : public ::testing::Test {
 protected:
  void open(std::shared_ptr<const Pyramid> pyramid, double isovalue) {
    pyramid_ = std::move(pyramid);
    session_ = std::make_unique<ViewSession>(pyramid_, renderer_, SessionOptions{2});
    session_->apply(InputEvent::resized(200, 100), 0.0, false);
    session_->state().surfaces[0].isovalue = isovalue;
    settle();
  }
  void frame(double seconds) {
    session_->update(clock_ += seconds);
    session_->draw();
    session_->noteDrawing(0.001);
  }
  void settle() {
    do {
      frame(0.05);
      std::this_thread::yield();
    } while (!session_->settled());
    frame(0.5);
    while (!session_->settled()) frame(0.05);
  }
  ViewState& state() { return session_->state(); }
  PieceChoice& choice() { return state().surfaces[0].pieces; }
  // Calls f(chunk, vertex, voxel) for all that is shown.
  template <typename F>
  void forEachVertex(F&& f) {
    for (const ChunkId id : renderer_.frame().chunks) {
      const SurfaceChunk chunk = renderer_.download(id);
      for (const SurfaceVertex& vertex : chunk.vertices)
        f(chunk, vertex, chunk.origin + glm::dvec3(vertex.position));
    }
  }
  // The balls that are shown, all vertices of which have their colours; around a focus those of
  // level 0 may have them.
  std::set<int> coloredBalls(double isovalue) {
    std::set<int> balls;
    bool are_right = true;
    forEachVertex(
        [&](const SurfaceChunk& chunk, const SurfaceVertex& vertex, const glm::dvec3& voxel) {
          const double large = std::abs(glm::distance(voxel, kLarge) - kLargeRadius + isovalue);
          const double small = std::abs(glm::distance(voxel, kSmall) - kSmallRadius + isovalue);
          const int ball = large <= small ? 0 : 1;
          balls.insert(ball);
          const bool is_plain = !state().focus.everywhere && vertex.value == kNoVertexValue;
          are_right = are_right && (is_plain || (vertex.value == ball && chunk.level == 0));
        });
    EXPECT_TRUE(are_right);
    return balls;
  }

  test::TemporaryFolder folder_;
  std::shared_ptr<const Pyramid> pyramid_;
  test::KeepingRenderer renderer_;
  std::unique_ptr<ViewSession> session_;
  double clock_ = 0.0;
};

TEST_F(SessionColorsTest, BallsHaveTheColoursOfTheirPlaces) {
  open(test::openTwoBalls(folder_), 0.0);
  EXPECT_FALSE(renderer_.frame().color_by_component);
  EXPECT_EQ(session_->known().listings(), 0u);
  state().coloring = ViewColoring::kComponent;
  frame(0.001);
  EXPECT_TRUE(session_->waitsForPieces());
  EXPECT_FALSE(session_->settled());
  EXPECT_EQ(session_->status().doing, "finding the pieces");
  EXPECT_EQ(session_->notes().meaning.patches.size(), 1u);  // that of the isovalue
  settle();
  EXPECT_FALSE(session_->waitsForPieces());
  EXPECT_TRUE(renderer_.frame().color_by_component);
  EXPECT_EQ(coloredBalls(0.0), (std::set<int>{0, 1}));
  const PictureLegend legend = session_->notes().meaning;
  ASSERT_EQ(legend.patches.size(), 2u);
  EXPECT_EQ(legend.patches[0].color, componentColor(0));
  EXPECT_EQ(legend.patches[1].color, componentColor(1));
  EXPECT_EQ(legend.patches[1].text.rfind("piece 1: ", 0), 0u) << legend.patches[1].text;
  EXPECT_EQ(legend.rest, "");

  // Around a focus, and with one of them hidden, listed once.
  state().focus.everywhere = false;
  state().focus.center = kSmall;
  state().focus.radius = 6.0;
  settle();
  EXPECT_EQ(coloredBalls(0.0), (std::set<int>{0, 1}));
  session_->listPieces(pyramid_->spec().geometry.indexToWorld(kLarge));
  settle();
  session_->hideSelectedPiece();
  settle();
  EXPECT_EQ(coloredBalls(0.0), (std::set<int>{1}));
  EXPECT_EQ(session_->notes().meaning.patches.size(), 1u);
  EXPECT_EQ(session_->notes().meaning.patches[0].color, componentColor(1));
  state().focus.everywhere = true;
  settle();
  EXPECT_EQ(coloredBalls(0.0), (std::set<int>{1}));
  EXPECT_EQ(session_->known().listings(), 1u);

  state().coloring = ViewColoring::kGradient;
  settle();
  EXPECT_FALSE(renderer_.frame().color_by_component);
  EXPECT_TRUE(renderer_.frame().value_window);
  state().coloring = ViewColoring::kPlain;
  choice() = {};
  settle();
  EXPECT_FALSE(renderer_.frame().color_by_component);
  forEachVertex([](const SurfaceChunk&, const SurfaceVertex& vertex, const glm::dvec3&) {
    ASSERT_EQ(vertex.value, kNoVertexValue);
  });
}

TEST_F(SessionColorsTest, AnotherIsovalueIsListedAtRestAlone) {
  open(test::openTwoBalls(folder_), 0.0);
  state().coloring = ViewColoring::kComponent;
  settle();
  for (int i = 1; i <= 20; ++i) {
    state().surfaces[0].isovalue = 0.1 * i;
    frame(0.016);
    EXPECT_TRUE(session_->waitsForPieces());
  }
  EXPECT_EQ(session_->known().listings(), 1u);
  settle();
  EXPECT_EQ(session_->known().listings(), 2u);
  EXPECT_EQ(coloredBalls(2.0), (std::set<int>{0, 1}));
  // Back again it is known.
  state().surfaces[0].isovalue = 0.0;
  settle();
  EXPECT_EQ(coloredBalls(0.0), (std::set<int>{0, 1}));
  EXPECT_EQ(session_->known().listings(), 2u);
}

// Colours alone change at rest: nothing gets coarser meanwhile.
TEST_F(SessionColorsTest, TheSurfaceStaysFineWhenItsColoursCome) {
  open(test::openTwoBalls(folder_), 0.0);
  const std::uint64_t all = session_->status().triangles;
  state().coloring = ViewColoring::kComponent;
  do {
    frame(0.02);
    EXPECT_EQ(session_->status().triangles, all);
    std::this_thread::yield();
  } while (!session_->settled());
  EXPECT_EQ(session_->status().triangles, all);
}

TEST_F(SessionColorsTest, EverySurfaceHasAListOfItsOwn) {
  open(test::openTwoBalls(folder_), 0.0);
  state().surfaces.push_back({5.0, {0.5f, 0.5f, 0.5f}, 0.5, true});
  state().surfaces.push_back({9.0, {0.5f, 0.5f, 0.5f}, 1.0, false});
  state().coloring = ViewColoring::kComponent;
  settle();
  EXPECT_EQ(session_->known().listings(), 2u);
  std::map<int, std::set<int>> colors;
  forEachVertex([&](const SurfaceChunk& chunk, const SurfaceVertex& vertex, const glm::dvec3&) {
    colors[chunk.surface].insert(vertex.value);
  });
  EXPECT_EQ(colors, (std::map<int, std::set<int>>{{0, {0, 1}}, {1, {0, 1}}}));
  const PictureLegend legend = session_->notes().meaning;
  ASSERT_EQ(legend.patches.size(), 4u);
  EXPECT_EQ(legend.patches[2].text.rfind("isovalue 5, piece 0: ", 0), 0u);
}

// Each connected part of what is shown has the colour of its place by area, found from the
// triangles alone.
TEST_F(SessionColorsTest, PiecesOfNoiseHaveTheColoursOfTheirOrder) {
  test::RandomCase random(5);
  const glm::dvec3 wave(0.9, 1.1, 0.7);
  open(test::openField(folder_, Index3(50),
                       [&](const glm::dvec3& p) {
                         return 40.0 * (std::sin(wave.x * p.x) + std::sin(wave.y * p.y) +
                                        std::sin(wave.z * p.z)) +
                                random.real(-30, 30);
                       }),
       70.0);
  state().coloring = ViewColoring::kComponent;
  settle();
  using Place = std::array<double, 3>;
  std::map<Place, std::uint32_t> numbers;  // equal places of one surface are one vertex
  std::vector<std::uint32_t> parents;
  std::vector<int> colors;
  const auto rootOf = [&](std::uint32_t v) {
    while (parents[v] != v) v = parents[v] = parents[parents[v]];
    return v;
  };
  std::vector<std::array<std::uint32_t, 3>> triangles;
  std::vector<glm::dvec3> places;
  for (const ChunkId id : renderer_.frame().chunks) {
    const SurfaceChunk chunk = renderer_.download(id);
    std::vector<std::uint32_t> of_chunk;
    for (const SurfaceVertex& vertex : chunk.vertices) {
      const glm::dvec3 at = chunk.origin + glm::dvec3(vertex.position);
      const auto [found, is_new] =
          numbers.try_emplace(Place{at.x, at.y, at.z}, static_cast<std::uint32_t>(parents.size()));
      if (is_new) {
        parents.push_back(found->second);
        colors.push_back(vertex.value);
        places.push_back(at);
      }
      ASSERT_EQ(colors[found->second], vertex.value);
      of_chunk.push_back(found->second);
    }
    for (std::size_t i = 0; i < chunk.triangles.size(); i += 3) {
      triangles.push_back({of_chunk[chunk.triangles[i]], of_chunk[chunk.triangles[i + 1]],
                           of_chunk[chunk.triangles[i + 2]]});
      for (const std::uint32_t corner : triangles.back())
        parents[rootOf(corner)] = rootOf(triangles.back()[0]);
    }
  }
  std::map<std::uint32_t, double> areas;
  for (const auto& [a, b, c] : triangles)
    areas[rootOf(a)] += glm::length(glm::cross(places[b] - places[a], places[c] - places[a])) / 2;
  std::vector<std::pair<double, std::uint32_t>> order;
  for (const auto& [root, area] : areas) order.emplace_back(area, root);
  std::ranges::sort(order, std::greater());
  ASSERT_GT(order.size(), 50u);
  std::map<std::uint32_t, std::size_t> places_of;
  std::size_t compared = 0;
  for (std::size_t i = 0; i < order.size(); ++i) {
    // Areas that rounding alone tells apart may come the other way round.
    const bool is_alone = (i == 0 || order[i - 1].first > 1.000001 * order[i].first) &&
                          (i + 1 == order.size() || order[i].first > 1.000001 * order[i + 1].first);
    if (!is_alone) continue;
    places_of[order[i].second] = i;
    ++compared;
  }
  EXPECT_GT(compared, 30u);
  for (std::uint32_t v = 0; v < parents.size(); ++v) {
    ASSERT_EQ(colors[v], colors[rootOf(v)]);
    const auto place = places_of.find(rootOf(v));
    if (place == places_of.end()) continue;
    ASSERT_EQ(static_cast<std::size_t>(colors[v]), place->second % kComponentColorCount);
  }
  const PictureLegend legend = session_->notes().meaning;
  EXPECT_EQ(legend.patches.size(), kComponentColorCount);
  EXPECT_EQ(legend.rest, "and " + std::to_string(order.size() - kComponentColorCount) +
                             " smaller, in the same colours");
}

TEST_F(SessionColorsTest, RandomEditsLeaveWhatAFreshSessionShows) {
  open(test::openTwoBalls(folder_), 0.0);
  test::RandomCase random(11);
  const GridGeometry& geometry = pyramid_->spec().geometry;
  const auto seedOf = [&](int ball) {
    return ComponentSeed{geometry.indexToWorld(ball == 0 ? kLarge - glm::dvec3(kLargeRadius, 0, 0)
                                                         : kSmall + glm::dvec3(kSmallRadius, 0, 0)),
                         1e6};
  };
  std::size_t colored = 0;
  for (int round = 0; round < 60; ++round) {
    for (int edit = random.uniform(1, 3); edit > 0; --edit) {
      switch (random.uniform(0, 7)) {
        case 0:
          choice() = {};
          break;
        case 1:
          choice() = {};
          choice().keep = {seedOf(random.uniform(0, 1))};
          break;
        case 2:
          choice().hide = {seedOf(random.uniform(0, 1))};
          break;
        case 3:
          state().focus.everywhere = random.chance(0.5);
          state().focus.center = random.chance(0.5) ? kSmall : kLarge;
          state().focus.radius = random.real(4, 40);
          break;
        case 4:
          state().surfaces[0].isovalue = 0.5 * random.uniform(-1, 2);
          break;
        case 5:
          state().coloring = random.chance(0.7) ? ViewColoring::kComponent : ViewColoring::kPlain;
          break;
        case 6:
          session_->listPieces(geometry.indexToWorld(random.chance(0.5) ? kSmall : kLarge));
          break;
        default:
          session_->hideSelectedPiece();
      }
      if (random.chance(0.5)) frame(random.real(0.0, 0.3));
    }
    settle();
    SCOPED_TRACE("round " + std::to_string(round));
    ASSERT_EQ(session_->status().error, "");
    const double isovalue = state().surfaces[0].isovalue;
    test::KeepingRenderer fresh_renderer;
    ViewSession fresh(pyramid_, fresh_renderer, {1});
    fresh.apply(InputEvent::resized(200, 100), 0.0, false);
    fresh.show(session_->state());
    for (double clock = 1.0; clock < 2.0 || !fresh.settled(); clock += 1.0) {
      fresh.update(clock);
      std::this_thread::yield();
    }
    ASSERT_EQ(session_->status().triangles, fresh.status().triangles);
    if (state().coloring != ViewColoring::kComponent) continue;
    coloredBalls(isovalue);
    if (session_->status().triangles > 0) ++colored;
  }
  EXPECT_GT(colored, 10u);
  EXPECT_LE(session_->known().listings(), 4u);  // one for each isovalue
}

// A brick that cannot be read: the reason in one line, and the surface in its own colour.
TEST_F(SessionColorsTest, AFailureIsSaidAndNothingWaits) {
  open(test::openTwoBalls(folder_), 0.0);
  auto known = std::make_shared<KnownComponents>();
  PieceList pieces(pyramid_, 1, known);
  pieces.want({std::numeric_limits<double>::infinity()}, 1.0);  // no query has it
  EXPECT_TRUE(pieces.waits());
  for (double clock = 1.0; pieces.waits(); clock += 1.0) {
    pieces.want({std::numeric_limits<double>::infinity()}, clock);
    pieces.update();
    std::this_thread::yield();
  }
  EXPECT_NE(pieces.wantedError(), "");
}

TEST_F(SessionColorsTest, The65thPieceThatIsHiddenIsRefusedInOneLine) {
  open(test::openField(folder_, Index3(41),
                       [](const glm::dvec3& p) {
                         const glm::dvec3 cell = glm::mod(p, 8.0) - 4.0;
                         return 2.7 - glm::length(cell);
                       }),
       0.0);
  session_->listPieces(std::nullopt);
  settle();
  ASSERT_EQ(session_->pieces().listed()->list().size(), 125u);
  for (std::size_t i = 0; i < kMostSeeds; ++i) {
    session_->pieces().select(i);
    session_->hideSelectedPiece();
    EXPECT_FALSE(session_->pieces().selected());
  }
  settle();
  EXPECT_EQ(session_->status().limited, "");
  const std::uint64_t shown = session_->status().triangles;
  session_->pieces().select(kMostSeeds);
  session_->hideSelectedPiece();
  settle();
  EXPECT_EQ(choice().hide.size(), kMostSeeds);
  EXPECT_EQ(session_->status().triangles, shown);
  EXPECT_EQ(session_->status().limited,
            "64 pieces are hidden, and no more can be: leave out small pieces, or keep one");
  EXPECT_TRUE(session_->pieces().selected());  // it may be kept instead
  choice().hide.pop_back();
  settle();
  EXPECT_EQ(session_->status().limited, "");
  session_->hideSelectedPiece();
  settle();
  EXPECT_EQ(choice().hide.size(), kMostSeeds);
  EXPECT_EQ(session_->status().limited, "");
}

}  // namespace
}  // namespace isobrick
