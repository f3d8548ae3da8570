// How deep a text of JSON is nested, before it is parsed.
#pragma once

#include <algorithm>
#include <cstddef>
#include <string_view>

namespace isobrick {

// The deepest nesting of brackets outside of strings, in one pass. Parsers, copies and walks take a
// stack as deep as that; and a callback of nlohmann's parser, which could refuse it too, takes time
// by the square of a list's length.
inline int nestingDepth(std::string_view text) {
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
  return deepest;
}

// No view, script or request that is meant is nested deeper.
inline constexpr int kMostNesting = 16;

}  // namespace isobrick
