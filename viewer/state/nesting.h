// JSON of unknown origin, before it is parsed.
#pragma once

#include <algorithm>
#include <cstddef>
#include <string_view>

namespace isobrick {

// No text that is meant is nested deeper: copies and texts of values take a stack as deep as they
// are. (A callback of the parser would refuse it as well, but takes time by the square of a list's
// length.)
inline constexpr int kMostNesting = 16;

// Whether the brackets outside of strings are nested deeper than kMostNesting.
inline bool isNestedTooDeep(std::string_view text) {
  int depth = 0, deepest = 0;
  bool is_string = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (c == '"') is_string = !is_string;
    if (is_string && c == '\\') ++i;
    if (is_string) continue;
    if (c == '[' || c == '{') deepest = std::max(deepest, ++depth);
    if (c == ']' || c == '}') --depth;
  }
  return deepest > kMostNesting;
}

}  // namespace isobrick
