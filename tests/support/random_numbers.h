// Random numbers for tests: the same seed gives the same numbers in every run.
#pragma once

#include <cstdint>
#include <random>

namespace isobrick::test {

using Random = std::mt19937_64;

// low .. high, both included.
inline std::int64_t randomInt(Random& random, std::int64_t low, std::int64_t high) {
  return std::uniform_int_distribution<std::int64_t>(low, high)(random);
}

// 0 .. end - 1; end is not 0.
inline std::uint64_t randomBelow(Random& random, std::uint64_t end) {
  return std::uniform_int_distribution<std::uint64_t>(0, end - 1)(random);
}

// low <= number < high.
inline double randomReal(Random& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}

}  // namespace isobrick::test
