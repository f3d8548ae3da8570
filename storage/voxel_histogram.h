// How often each value occurs among the voxels of level 0.
#pragma once

#include <bit>
#include <cstdint>
#include <limits>
#include <span>
#include <type_traits>
#include <vector>

#include "isobrick/storage/voxel_type.h"

namespace isobrick {

// Integer types have a bin for every value: exact. float32 has a bin for all values that share the
// upper 16 bits, sign, exponent and 7 bits of mantissa: at most 1/128 of the value wide. Bins are
// in the order of their values, from that of the least voxel to that of the greatest.
class VoxelHistogram {
 public:
  // The most bins, however many values there are.
  static constexpr std::size_t kMostBins = 65536;

  // Holds no voxels yet; they will be of the type and in the range.
  VoxelHistogram(VoxelType type, const ValueRange& range);

  // Number of bins.
  std::size_t bins() const { return counts_.size(); }
  // Voxels by bin.
  std::span<std::uint64_t> counts() { return counts_; }
  // Voxels by bin.
  std::span<const std::uint64_t> counts() const { return counts_; }
  // The values that a voxel of the bin may have; one value for integer types.
  ValueRange bin(std::size_t i) const;

  // The counts in `bins` equal parts of [least, greatest], which is not empty. A float's bin is
  // shared out over the parts that it touches, the bin of an integer v over [v - 1/2, v + 1/2].
  std::vector<double> inEqualParts(double least, double greatest, std::size_t bins) const;

 private:
  VoxelType type_;
  std::uint32_t first_key_;
  std::vector<std::uint64_t> counts_;
};

// A number below VoxelHistogram::kMostBins that orders voxels of one type as their values do; equal
// for voxels of one bin. `value` is finite.
template <typename T>
std::uint32_t histogramKey(T value) {
  if constexpr (std::is_same_v<T, float>) {
    const auto bits = std::bit_cast<std::uint32_t>(value + 0.0f);  // -0 is 0
    constexpr std::uint32_t kSign = 0x80000000;
    return ((bits & kSign) != 0 ? ~bits : bits | kSign) >> 16;
  } else {
    return static_cast<std::uint32_t>(value - std::numeric_limits<T>::lowest());
  }
}

}  // namespace isobrick
