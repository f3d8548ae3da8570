// Pieces in a session without a window: listed, picked, kept, hidden, measured and written.
#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>
#include <thread>

#include "isobrick/extract/sinks/vertex_numbering.h"
#include "isobrick/viewer/session/mesh_queue.h"
#include "isobrick/viewer/session/view_session.h"
#include "tests/support/null_renderer.h"
#include "tests/support/ply_reader.h"
#include "tests/support/two_balls.h"

namespace isobrick {
namespace {

using test::kLarge;
using test::kLargeRadius;
using test::kSmall;
using test::kSmallRadius;

class SessionPiecesTest : public ::testing::Test {
 protected:
  SessionPiecesTest() {
    pyramid_ = test::openTwoBalls(folder_);
    session_ = std::make_unique<ViewSession>(pyramid_, renderer_, SessionOptions{2});
    session_->apply(InputEvent::resized(200, 100), 0.0, false);
    session_->state().surfaces[0].isovalue = 0.0;
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
  }
  void listAt(const glm::dvec3& index) {
    session_->listPieces(pyramid_->spec().geometry.indexToWorld(index));
    settle();
  }
  void key(Key key) {
    InputEvent event;
    event.kind = InputEvent::Kind::kKeyPress;
    event.key = key;
    session_->apply(event, clock_, false);
  }
  // Of level 0, as listed.
  std::uint64_t trianglesOf(std::size_t place) const {
    return session_->pieces().listed()->list().at(place).triangles;
  }
  std::uint64_t shown() const { return session_->status().triangles; }

  test::TemporaryFolder folder_;
  std::shared_ptr<const Pyramid> pyramid_;
  NullRenderer renderer_;
  std::unique_ptr<ViewSession> session_;
  double clock_ = 0.0;
};

TEST_F(SessionPiecesTest, AreListedWithTheMeasuresOfTheBalls) {
  session_->listPieces(std::nullopt);
  EXPECT_FALSE(session_->settled());
  settle();
  ASSERT_TRUE(session_->piecesAreCurrent());
  const ListedComponents& listed = *session_->pieces().listed();
  ASSERT_EQ(listed.list().size(), 2u);
  EXPECT_EQ(listed.level(), 0);
  EXPECT_EQ(session_->pieces().selectedPiece(), nullptr);
  EXPECT_EQ(session_->pieces().progress(), 1.0f);
  EXPECT_EQ(trianglesOf(0) + trianglesOf(1), shown());
  const GridGeometry& geometry = pyramid_->spec().geometry;
  const double radii[2] = {0.5 * kLargeRadius, 0.5 * kSmallRadius};
  const glm::dvec3 centers[2] = {geometry.indexToWorld(kLarge), geometry.indexToWorld(kSmall)};
  for (std::size_t i = 0; i < 2; ++i) {
    const SurfaceComponent& piece = listed.list()[i];
    const double r = radii[i], area = 4 * std::numbers::pi * r * r;
    // The chords of a mesh with edges h lie below the sphere by h^2 / 8r, here h <= 0.87.
    EXPECT_LT(piece.area, area);
    EXPECT_NEAR(piece.area, area, 0.005 * area);
    EXPECT_LT(piece.volume.value(), area * r / 3);
    EXPECT_NEAR(piece.volume.value(), area * r / 3, 0.01 * area * r / 3);
    EXPECT_LT(glm::distance(piece.center, centers[i]), 1e-3);
    for (int axis = 0; axis < 3; ++axis)
      EXPECT_NEAR(piece.upper[axis] - piece.lower[axis], 2 * r,
                  2.5e-4);  // rule 8: 1 / 4096 of an edge
  }
  session_->state().surfaces[0].isovalue = 1.0;
  EXPECT_FALSE(session_->piecesAreCurrent());
}

TEST_F(SessionPiecesTest, AnotherLevelIsListedIfLevel0IsTooMuch) {
  PieceList pieces(pyramid_, 1, std::make_shared<KnownComponents>(), 16 * 16 * 16 * 10);
  pieces.request(0.0, pyramid_->spec().geometry.indexToWorld(kSmall));
  while (pieces.busy()) {
    pieces.update();
    std::this_thread::yield();
  }
  ASSERT_TRUE(pieces.listed()) << pieces.error();
  EXPECT_GT(pieces.listed()->level(), 0);
  EXPECT_EQ(pieces.listed()->list().size(), 2u);
  EXPECT_EQ(pieces.selected(), 1u);
}

TEST_F(SessionPiecesTest, ThePickedOneIsKeptOrHidden) {
  const std::uint64_t all = shown();
  listAt(kSmall + glm::dvec3(kSmallRadius, 0, 0));
  ASSERT_EQ(session_->pieces().selected(), 1u);
  key(Key::kDelete);  // not while nothing is picked with the tool
  settle();
  EXPECT_EQ(shown(), all);
  key(Key::kK);
  key(Key::kEnter);
  settle();
  EXPECT_EQ(shown(), trianglesOf(1));
  EXPECT_TRUE(session_->status().limited.empty());
  key(Key::kEscape);  // its box goes with the tool
  EXPECT_EQ(session_->pieces().selectedPiece(), nullptr);
  key(Key::kK);
  listAt(kSmall + glm::dvec3(kSmallRadius, 0, 0));
  // The whole choice is one step back.
  InputEvent undo;
  undo.kind = InputEvent::Kind::kKeyPress;
  undo.key = Key::kZ;
  undo.control = true;
  session_->apply(undo, clock_, false);
  settle();
  EXPECT_EQ(shown(), all);
  key(Key::kDelete);
  settle();
  EXPECT_EQ(shown(), trianglesOf(0));
}

// All that is asked of one isovalue uses one list, and what is left is not shown coarser meanwhile.
TEST_F(SessionPiecesTest, AreListedOnceAndTheRestStaysFine) {
  listAt(kLarge);
  listAt(kSmall);
  ASSERT_EQ(session_->pieces().selected(), 1u);
  const std::uint64_t all = shown();
  session_->hideSelectedPiece();
  while (shown() == all) {
    frame(0.001);
    std::this_thread::yield();
  }
  EXPECT_EQ(shown(), trianglesOf(0));
  settle();
  EXPECT_EQ(shown(), trianglesOf(0));
  listAt(kLarge);
  session_->keepSelectedPiece();
  settle();
  session_->state().coloring = ViewColoring::kComponent;
  settle();
  EXPECT_EQ(session_->known().listings(), 1u);
  session_->state().surfaces[0].isovalue = 0.5;
  settle();
  EXPECT_EQ(session_->known().listings(), 2u);
}

TEST_F(SessionPiecesTest, AChoiceHoldsWhenFocusAndIsovalueChange) {
  listAt(kLarge);
  session_->keepSelectedPiece();
  settle();
  ViewState& state = session_->state();
  state.focus.everywhere = false;
  state.focus.center = kSmall;
  state.focus.radius = 6.0;
  settle();
  EXPECT_GT(shown(), 0u);
  EXPECT_LT(shown(), trianglesOf(0));  // coarser, and alone
  state.focus.everywhere = true;
  for (int i = 0; i < 10; ++i) {
    state.surfaces[0].isovalue = 0.2 * i;
    frame(0.016);
  }
  settle();
  listAt(kLarge);
  EXPECT_EQ(shown(), trianglesOf(0));
  // At the last isovalue the small ball is no more, at this one the large one neither.
  state.surfaces[0].pieces = {{{pyramid_->spec().geometry.indexToWorld(kSmall), 1.0}}, {}, 0.0};
  state.surfaces[0].isovalue = 15.0;
  settle();
  EXPECT_EQ(session_->status().limited, "1 chosen piece is not there at this isovalue");
  EXPECT_GT(shown(), 0u);
  state.surfaces[0].pieces = {{}, {}, 1e9};
  settle();
  EXPECT_EQ(shown(), 0u);
}

TEST_F(SessionPiecesTest, MeshesHaveTheChosenPiecesAlone) {
  listAt(kSmall);
  session_->keepSelectedPiece();
  MeshQueue queue(2);
  const std::string path = folder_.file("small.ply");
  queue.add(session_->meshOrder(path));
  std::optional<MeshQueue::Outcome> outcome;
  while (!(outcome = queue.poll())) std::this_thread::yield();
  EXPECT_EQ(outcome->error, "");
  EXPECT_EQ(test::readPly(path).triangles.size(), 3 * trianglesOf(1));
}

TEST_F(SessionPiecesTest, MeasuresGoIntoTheView) {
  session_->measureSelectedPiece();
  EXPECT_TRUE(session_->state().piece_measures.empty());
  listAt(kSmall);
  session_->measureSelectedPiece();
  ASSERT_EQ(session_->state().piece_measures.size(), 1u);
  EXPECT_EQ(session_->state().piece_measures[0],
            measureOf(session_->pieces().listed()->list()[1], 0.0, 0));
}

}  // namespace
}  // namespace isobrick
