#include "isobrick/storage/voxel_histogram.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

namespace isobrick {
namespace {

// The float whose number in the order of the values has histogramKey() as its upper half.
float ofOrderedBits(std::uint32_t ordered) {
  constexpr std::uint32_t kSign = 0x80000000;
  return std::bit_cast<float>((ordered & kSign) != 0 ? ordered & ~kSign : ~ordered);
}

std::uint32_t keyOf(VoxelType type, float value) {
  return visitVoxelType(type, [&](auto tag) {
    using T = typename decltype(tag)::Type;
    return histogramKey(static_cast<T>(value));
  });
}

}  // namespace

VoxelHistogram::VoxelHistogram(VoxelType type, const ValueRange& range)
    : type_(type), first_key_(keyOf(type, range.min)) {
  counts_.resize(keyOf(type, range.max) - first_key_ + 1);
}

ValueRange VoxelHistogram::bin(std::size_t i) const {
  const auto key = first_key_ + static_cast<std::uint32_t>(i);
  if (type_ == VoxelType::kFloat32) {
    const std::uint32_t least = key << 16;
    constexpr std::uint32_t kNegativeZero = 0x7fffffff;  // counts as 0
    const std::uint32_t greatest = least | 0xffff;
    return {ofOrderedBits(least),
            ofOrderedBits(greatest == kNegativeZero ? greatest - 1 : greatest)};
  }
  return visitVoxelType(type_, [&](auto tag) -> ValueRange {
    using T = typename decltype(tag)::Type;
    const float value =
        static_cast<float>(key) + static_cast<float>(std::numeric_limits<T>::lowest());
    return {value, value};
  });
}

std::vector<double> VoxelHistogram::inEqualParts(double least, double greatest,
                                                 std::size_t bins) const {
  std::vector<double> parts(bins, 0.0);
  const double per_part = (greatest - least) / static_cast<double>(bins);
  const double margin = type_ == VoxelType::kFloat32 ? 0.0 : 0.5;
  const double last = static_cast<double>(bins) - 1.0;
  for (std::size_t i = 0; i < counts_.size(); ++i) {
    if (counts_[i] == 0) continue;
    const ValueRange values = bin(i);
    const double from = (static_cast<double>(values.min) - margin - least) / per_part;
    const double to = (static_cast<double>(values.max) + margin - least) / per_part;
    const auto first_part = static_cast<std::size_t>(std::clamp(std::floor(from), 0.0, last));
    const auto last_part = static_cast<std::size_t>(std::clamp(std::floor(to), 0.0, last));
    const double begin = std::clamp(from, 0.0, last + 1.0), end = std::clamp(to, 0.0, last + 1.0);
    const double count = static_cast<double>(counts_[i]);
    if (!(end > begin)) {
      parts[first_part] += count;
      continue;
    }
    for (std::size_t part = first_part; part <= last_part; ++part) {
      const double share = std::min(end, static_cast<double>(part) + 1.0) -
                           std::max(begin, static_cast<double>(part));
      parts[part] += count * std::max(share, 0.0) / (end - begin);
    }
  }
  return parts;
}

}  // namespace isobrick
