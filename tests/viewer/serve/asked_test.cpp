// Words of addresses and members of messages: numbers within their bounds, or an error of one line.
#include "isobrick/viewer/serve/asked.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <ctime>
#include <string>

#include "isobrick/storage/error.h"
#include "tests/support/random_numbers.h"
#include "tests/support/repetitions.h"

namespace isobrick {
namespace {

TEST(Asked, WordsOfAnAddressAreNumbersOrText) {
  const Asked words = Asked::ofAddress("iso=-1.5e2&focus=1%2C2,3.5&level=2&pair=1,2&name=a%20b");
  EXPECT_EQ(words.number("iso"), -150.0);
  EXPECT_EQ(words.within("iso", -1000, 1000), -150.0);
  EXPECT_EQ(words.point("focus"), glm::dvec3(1, 2, 3.5));
  EXPECT_EQ(words.integer("level", 0, 3), 2);
  EXPECT_EQ((*words.pair("pair"))[1], 2.0);
  EXPECT_EQ(words.text("name"), "a b");
  EXPECT_FALSE(words.number("other"));
  EXPECT_EQ(words.text("other"), "");
  EXPECT_EQ(words.clamped("iso", 0, 1), 0.0);
  EXPECT_THROW(words.within("iso", 0, 1), Error);
  EXPECT_THROW(words.integer("iso", 0, 1), Error);
  EXPECT_THROW(words.needed("other", 0, 1), Error);
  EXPECT_THROW(words.point("pair"), Error);
  EXPECT_THROW(words.pair("focus"), Error);
  EXPECT_THROW(words.flag("iso"), Error);
  EXPECT_THROW(words.objects("focus", 3), Error);
  EXPECT_EQ(Asked::ofAddress("a=1&b=2").normalized(), Asked::ofAddress("b=2&a=1").normalized());
  EXPECT_NE(Asked::ofAddress("a=1&b=2").normalized(), Asked::ofAddress("a=12&b=").normalized());
}

TEST(Asked, OtherTextIsRefused) {
  for (const char* const wrong : {"a", "=1", "a=1&a=2", "a=%", "a=%4", "a=%zz", "a=%-1", "&"})
    EXPECT_THROW(Asked::ofAddress(wrong), Error) << wrong;
  for (const char* const none : {"x=nan", "x=inf", "x=1e999", "x=1,", "x=", "x=0x1", "x=1],[2",
                                 "x=\"1\"", "x=true", "x={}", "x=%ff"})
    EXPECT_THROW(Asked::ofAddress(none).number("x"), Error) << none;
}

TEST(Asked, WhatIsNestedDeeplyIsRefused) {
  const auto nested = [](std::size_t depth) {
    return std::string(depth, '[') + R"("[[\"[[")" + std::string(depth, ']');
  };
  EXPECT_NO_THROW(Asked::ofMessage("{\"x\":" + nested(15) + "}"));
  EXPECT_THROW(Asked::ofMessage("{\"x\":" + nested(16) + "}"), Error);
  EXPECT_THROW(Asked::ofMessage(nested(30'000)), Error);
  EXPECT_THROW(Asked::ofAddress("x=" + nested(30)), Error);
}

// Of the thread, so that other work on the machine does not count.
double secondsFor(int objects) {
  std::string text = "{\"x\":[{}";
  for (int i = 1; i < objects; ++i) text += ",{}";
  text += "]}";
  const auto now = [] {
    timespec time{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
    return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
  };
  double least = 1e9;
  for (int i = 0; i < 9; ++i) {
    const double begin = now();
    Asked::ofMessage(text);
    least = std::min(least, now() - begin);
  }
  return least;
}

// Twenty times the length; by its square it would be four hundred times.
TEST(Asked, TheTimeGoesByTheLength) { EXPECT_LT(secondsFor(40'000), 100 * secondsFor(2'000)); }

TEST(Asked, RandomBytesAreRefusedOrBounded) {
  const std::string pieces = "0123456789.,=&%-+eE[]{}\"\\\xff\x01xn";
  const std::string seed = "iso=5e2&focus=1,2,3&radius=-7&axis=x&window=0,1&size=99";
  test::Random random(51);
  for (int i = 0; i < test::repetitions(20'000); ++i) {
    std::string text = seed;
    for (std::uint64_t edits = test::randomBelow(random, 5); edits > 0; --edits)
      text[test::randomBelow(random, text.size())] =
          pieces[test::randomBelow(random, pieces.size())];
    try {
      const Asked words = Asked::ofAddress(text);
      EXPECT_FALSE(words.normalized().empty());
      const auto radius = words.within("radius", -10.0, 10.0);
      ASSERT_TRUE(!radius || std::abs(*radius) <= 10.0) << text;
      const auto focus = words.point("focus");
      for (int axis = 0; focus && axis < 3; ++axis) ASSERT_LE(std::abs((*focus)[axis]), 1e12);
      words.text("axis");
    } catch (const Error& refused) {
      ASSERT_EQ(std::string(refused.what()).find('\n'), std::string::npos);
    }
  }
}

}  // namespace
}  // namespace isobrick
