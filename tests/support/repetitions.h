// How often a test of random cases tries.
#pragma once

#include "tests/support/requirement.h"

namespace isobrick::test {

// `usual`, or so many percent of it as ISOBRICK_REPETITIONS says, at least 1: fewer under
// sanitizers, where each case takes ten times as long, and many more in a night.
inline int repetitions(int usual) {
  const long long percent = environmentOr("ISOBRICK_REPETITIONS", 100);
  const long long scaled = usual * percent / 100;
  return scaled < 1 ? 1 : static_cast<int>(scaled);
}

}  // namespace isobrick::test
