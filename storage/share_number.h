// One of several shares of a work, which processes and machines do apart.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "isobrick/storage/error.h"

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
inline NumberRun runOfShare(std::size_t all, const ShareNumber& share) {
  if (share.of < 1 || share.of > kMostShares || share.number < 1 || share.number > share.of)
    throw Error("there is no share " + std::to_string(share.number) + " of " +
                std::to_string(share.of) + "; they count from 1, up to " +
                std::to_string(kMostShares));
  // Whole numbers: a product of things and shares fits into 64 bits.
  const auto begin = [&](std::uint64_t number) {
    return static_cast<std::size_t>(all * number / share.of);
  };
  const std::size_t first = begin(share.number - 1);
  return {first, begin(share.number) - first};
}

}  // namespace isobrick
