// How often a test of random cases tries.
#pragma once

#include <algorithm>
#include <cstddef>
#include <span>

#include "tests/support/requirement.h"

namespace isobrick::test {

// `usual`, or so many percent of it as ISOBRICK_REPETITIONS says, at least 1: fewer under
// sanitizers, where each case takes ten times as long, and many more in a night.
inline int repetitions(int usual) {
  const long long percent = environmentOr("ISOBRICK_REPETITIONS", 100);
  const long long scaled = usual * percent / 100;
  return scaled < 1 ? 1 : static_cast<int>(scaled);
}

// That share of some cases, the first ones.
template <typename T, std::size_t kCount>
std::span<const T> someOf(const T (&cases)[kCount]) {
  const auto count = static_cast<std::size_t>(repetitions(static_cast<int>(kCount)));
  return std::span(cases).first(std::min(count, kCount));
}

}  // namespace isobrick::test
