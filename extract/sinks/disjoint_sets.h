// Sets of numbers that grow together, for connected components.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

namespace isobrick {

// The least number of the set of `number`: its root, which is its own parent. `parents` has an
// entry for every number, at most the number itself; at first each number is a set. Every number on
// the way gets its grandparent as its parent, so that ways stay short.
inline std::uint32_t rootOf(std::vector<std::uint32_t>& parents, std::uint32_t number) {
  while (parents[number] != number) {
    parents[number] = parents[parents[number]];
    number = parents[number];
  }
  return number;
}

// Makes one set of those of `a` and `b`.
inline void joinSets(std::vector<std::uint32_t>& parents, std::uint32_t a, std::uint32_t b) {
  a = rootOf(parents, a);
  b = rootOf(parents, b);
  parents[std::max(a, b)] = std::min(a, b);
}

}  // namespace isobrick
