#include "isobrick/storage/share_number.h"

#include <string>

#include "isobrick/storage/error.h"

namespace isobrick {

NumberRun runOfShare(std::size_t all, const ShareNumber& share) {
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
