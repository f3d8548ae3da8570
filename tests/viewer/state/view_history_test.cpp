// Undo and redo of views, at times of the test's own.
#include "isobrick/viewer/state/view_history.h"

#include <gtest/gtest.h>

namespace isobrick {
namespace {

class ViewHistoryTest : public ::testing::Test {
 protected:
  // The user sets the isovalue; `seconds` later the view rests still, or is changed again.
  void set(double isovalue, double seconds, bool is_held = false) {
    view_.surfaces[0].isovalue = isovalue;
    history_.note(view_, is_held, seconds_);
    seconds_ += seconds;
    history_.note(view_, is_held, seconds_);
  }
  std::optional<double> undo() { return go(history_.undo(view_)); }
  std::optional<double> redo() { return go(history_.redo(view_)); }

  ViewHistory history_;
  ViewState view_ = [] {
    ViewState state;
    state.surfaces.resize(1);
    return state;
  }();

 private:
  std::optional<double> go(const std::optional<ViewState>& to) {
    if (!to) return std::nullopt;
    view_ = *to;
    history_.note(view_, false, seconds_ += 1);
    return view_.surfaces[0].isovalue;
  }
  double seconds_ = 0;
};

TEST_F(ViewHistoryTest, GoesBackAndForth) {
  EXPECT_EQ(undo(), std::nullopt);
  for (const double isovalue : {1.0, 2.0, 3.0}) set(isovalue, 1);
  EXPECT_EQ(undo(), 2.0);
  EXPECT_EQ(undo(), 1.0);
  EXPECT_EQ(undo(), std::nullopt);
  EXPECT_EQ(redo(), 2.0);
  EXPECT_EQ(redo(), 3.0);
  EXPECT_EQ(redo(), std::nullopt);
  // What comes after a change takes the place of what was undone.
  EXPECT_EQ(undo(), 2.0);
  set(5, 1);
  EXPECT_EQ(redo(), std::nullopt);
  EXPECT_EQ(undo(), 2.0);
}

TEST_F(ViewHistoryTest, ADragIsOneStepAndQuickChangesAre) {
  set(1, 1);
  for (int i = 0; i < 50; ++i) set(10 + i, 0.5, true);
  set(60, 1);
  for (int i = 0; i < 50; ++i) set(100 + i, 0.1);
  set(200, 1);
  EXPECT_EQ(undo(), 60.0);
  EXPECT_EQ(undo(), 1.0);
  EXPECT_EQ(redo(), 60.0);
}

TEST_F(ViewHistoryTest, UndoRightAfterAChangeLosesNothing) {
  set(1, 1);
  set(2, 0.01);
  EXPECT_EQ(undo(), 1.0);
  EXPECT_EQ(redo(), 2.0);
}

TEST_F(ViewHistoryTest, OldViewsAreForgotten) {
  for (int i = 0; i < 500; ++i) set(i, 1);
  std::size_t steps = 0;
  while (undo()) ++steps;
  EXPECT_EQ(steps, ViewHistory::kMostViews - 1);
  EXPECT_EQ(view_.surfaces[0].isovalue, 500.0 - ViewHistory::kMostViews);
}

}  // namespace
}  // namespace isobrick
