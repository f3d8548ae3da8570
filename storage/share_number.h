// One of several shares of a work, which processes and machines do apart.
#pragma once

#include <cstddef>
#include <cstdint>

namespace isobrick {

// A share, counted from 1.
struct ShareNumber {
  std::uint32_t number = 1;  // 1 .. of
  std::uint32_t of = 1;      // shares in all
};

// The most shares that anything is divided into.
inline constexpr std::uint32_t kMostShares = 1'000'000;

// Neighbours among things that are numbered from 0.
struct NumberRun {
  std::size_t first = 0;  // the number of the first
  std::size_t count = 0;  // may be 0
};

// The things of a share, of `all`. The runs of all shares follow each other, and each thing is in
// one. All have the same number of things, or one more. Throws Error unless 1 <= number <= of <=
// kMostShares.
NumberRun runOfShare(std::size_t all, const ShareNumber& share);

}  // namespace isobrick
