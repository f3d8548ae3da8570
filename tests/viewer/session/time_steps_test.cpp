// Which steps of time stay open.
#include "isobrick/viewer/session/time_steps.h"

#include <gtest/gtest.h>

namespace isobrick {
namespace {

OpenedVolume openedStep(int step) {
  OpenedVolume opened;
  opened.step = step;
  return opened;
}

TEST(TimeStepsTest, OneVolumeHasNone) {
  EXPECT_EQ(TimeSteps({}, 2).count(), 0);
  EXPECT_EQ(TimeSteps({"a"}, 2).count(), 0);
  EXPECT_EQ(TimeSteps({"a", "b"}, 2).count(), 2);
}

TEST(TimeStepsTest, ThoseThatPlayNextStayOpenAndNoMoreThanHaveRoom) {
  TimeSteps steps({"0", "1", "2", "3", "4"}, 3);
  EXPECT_EQ(steps.path(3), "3");
  for (int step = 0; step < 25; ++step) {
    const int next = (step + 1) % 5, shown = step % 5;
    if (!steps.find(shown, shown)) steps.keep(openedStep(shown));
    if (!steps.find(next, shown)) {
      EXPECT_LT(steps.openCount(), 3u);
      EXPECT_TRUE(steps.find(shown, shown));  // it is on the screen
      steps.keep(openedStep(next));
    }
    EXPECT_EQ(steps.find(next, shown)->step, next);
    EXPECT_LE(steps.openCount(), 3u);
  }
  steps.closeAll();
  EXPECT_FALSE(steps.find(0, 0));
}

TEST(TimeStepsTest, AllAreOpenedOnceIfAllHaveRoom) {
  TimeSteps steps({"0", "1", "2", "3", "4"}, 5);
  int opened = 0;
  for (int step = 0; step < 25; ++step)
    if (!steps.find(step % 5, std::max(0, step - 1) % 5)) {
      steps.keep(openedStep(step % 5));
      ++opened;
    }
  EXPECT_EQ(opened, 5);
}

}  // namespace
}  // namespace isobrick
