#include <gtest/gtest.h>

#include "tools/bench/bench_report.h"

namespace isobrick {
namespace {

TEST(SpreadOf, OneValueIsAllThree) {
  const Spread spread = spreadOf({2.5});
  EXPECT_EQ(spread.median, 2.5);
  EXPECT_EQ(spread.min, 2.5);
  EXPECT_EQ(spread.max, 2.5);
}

TEST(SpreadOf, TheMiddleOneOfAnOddNumberInAnyOrder) {
  const Spread spread = spreadOf({9, 1, 100, 4, 2});
  EXPECT_EQ(spread.median, 4);
  EXPECT_EQ(spread.min, 1);
  EXPECT_EQ(spread.max, 100);
}

TEST(SpreadOf, TheMeanOfTheMiddleTwoOfAnEvenNumber) { EXPECT_EQ(spreadOf({8, 1, 2, 4}).median, 3); }

}  // namespace
}  // namespace isobrick
