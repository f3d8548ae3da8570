// Numbers as text.
#include "isobrick/preprocess/number_text.h"

#include <gtest/gtest.h>

#include <limits>

namespace isobrick {
namespace {

TEST(NumberTextTest, IsTheShortestThatReadsBackTheSame) {
  EXPECT_EQ(numberText(0.1), "0.1");
  EXPECT_EQ(numberText(1.0 / 3), "0.3333333333333333");
  EXPECT_EQ(numberText(-2e20), "-2e+20");
  EXPECT_EQ(numberText(0.1 + 0.2), "0.30000000000000004");
  // std::stod() throws at numbers below the smallest normal one.
  for (const double number : {1e-310, std::numeric_limits<double>::denorm_min()})
    EXPECT_EQ(numberIn<double>(numberText(number)), number);
  EXPECT_EQ(pointText({1, -0.5, 2e-30}), "1,-0.5,2e-30");
  EXPECT_EQ(indexText({1, 2, 3}, " x "), "1 x 2 x 3");
}

}  // namespace
}  // namespace isobrick
