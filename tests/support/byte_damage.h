// Every byte of a file changed to three values, and every end of it cut off: numbered, for tests
// that try all of them, or some.
#pragma once

#include <algorithm>
#include <cstdint>
#include <string>

#include "tests/support/random_numbers.h"
#include "tests/support/repetitions.h"

namespace isobrick::test {

inline std::size_t damageCount(const std::string& good) { return 4 * good.size(); }

// Number 3 n + v: byte n with a bit flipped, 0 or 255, or its complement where it is that already;
// from 3 times the size on: the first bytes alone.
inline std::string damaged(const std::string& good, std::size_t number) {
  const std::size_t at = number / 3;
  if (at >= good.size()) return good.substr(0, number - 3 * good.size());
  const auto right = static_cast<unsigned char>(good[at]);
  const unsigned wrong[] = {right ^ (1u << at % 8), 0u, 255u};
  const unsigned value = wrong[number % 3];
  std::string bad = good;
  bad[at] = static_cast<char>(value == right ? ~value : value);
  return bad;
}

// Calls f(number) for `usual` damages, scaled by repetitions(), spread over all; for each of them
// if that is as many. Returns how many it were.
template <typename F>
std::size_t forSomeDamages(const std::string& good, int usual, F&& f) {
  const std::size_t all = damageCount(good);
  const std::size_t tries = std::min(all, static_cast<std::size_t>(repetitions(usual)));
  Random random(7);
  for (std::size_t i = 0; i < tries; ++i) {
    const std::size_t first = i * all / tries, end = (i + 1) * all / tries;
    f(first + randomBelow(random, end - first));
  }
  return tries;
}

}  // namespace isobrick::test
