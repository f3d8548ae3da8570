// JSON of unknown origin: how deep it may be, and what it takes.
#include "isobrick/preprocess/shallow_json.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <string>

namespace isobrick {
namespace {

std::string nested(int depth) {
  const auto count = static_cast<std::size_t>(depth);
  return std::string(count, '[') + "1" + std::string(count, ']');
}

TEST(ShallowJson, TextThatIsNestedDeepIsDiscarded) {
  EXPECT_FALSE(parseShallowJson(nested(32)).is_discarded());
  for (const int depth : {33, 1000, 1000000}) {
    EXPECT_TRUE(parseShallowJson(nested(depth)).is_discarded()) << depth;
    EXPECT_EQ(nestingDepth(nested(depth)), depth);
  }
  EXPECT_TRUE(parseShallowJson("{\"a\": [").is_discarded());
}

TEST(ShallowJson, BracketsInTextsDoNotCount) {
  const auto json = parseShallowJson(R"({"a": ")" + std::string(1000, '[') + R"(\"[[[", "b": []})");
  EXPECT_EQ(textOf(member(json, "a")).size(), 1004u);
  EXPECT_EQ(nestingDepth(R"(["\\\\", [")" + std::string(9, '{') + R"("]])"), 2);
}

// Sixteen times as long takes sixteen times as much; 256 times if each item looked at all others.
TEST(ShallowJson, AListTakesTimeByItsLength) {
  const auto secondsOf = [](int items) {
    std::string text = "[0";
    for (int i = 0; i < items; ++i) text += ",{\"a\":[1]}";
    text += "]";
    double least = 1e9;
    for (int round = 0; round < 3; ++round) {
      const auto begin = std::chrono::steady_clock::now();
      EXPECT_EQ(parseShallowJson(text).size(), static_cast<std::size_t>(items) + 1);
      const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - begin;
      least = std::min(least, taken.count());
    }
    return least;
  };
  EXPECT_LT(secondsOf(80000), 80 * secondsOf(5000));
}

}  // namespace
}  // namespace isobrick
