// The error bound of rule 15 as it is stored: a byte for each cell and bin of isovalues.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>

#include "isobrick/storage/value_range.h"

namespace isobrick {

// // Levels that may have bounds. Errors of level 1 are found exactly when a query asks for them;
// cells of 8 voxels are as coarse as a tolerance gets.
inline constexpr int kFirstErrorLevel = 2;
inline constexpr int kMostErrorLevel = 3;

// Bins of isovalues, the same for the whole file. Bin i holds the isovalues v with
// i = floor((v - first) / width), computed in double; the first holds all below it too, the last
// all above.
struct ErrorBins {
  static constexpr std::uint32_t kMost = 256;

  double first = 0, width = 0;  // in the voxels' units; finite, width > 0
  std::uint32_t count = 0;      // 0: the file has no bounds
  int last_level = 0;           // kFirstErrorLevel .. kMostErrorLevel, where there are bounds

  bool operator==(const ErrorBins&) const = default;

  std::uint32_t binOf(double value) const {
    const double bin = std::floor((value - first) / width);
    return static_cast<std::uint32_t>(std::clamp(bin, 0.0, static_cast<double>(count) - 1));
  }
  // Where the isovalues of a bin lie; the ends of the first and of the last are infinite.
  double least(std::uint32_t bin) const {
    return bin == 0 ? -std::numeric_limits<double>::infinity() : first + bin * width;
  }
  double greatest(std::uint32_t bin) const {
    return bin + 1 == count ? std::numeric_limits<double>::infinity() : first + (bin + 1) * width;
  }

  // What the codes count in.
  double unit() const { return width * count * 0x1p-14; }
};

// One byte for an error: code 0 is exactly 0, code c in 1 .. 254 is
//   (1 + (c mod 16) / 16) * 2^(c / 16) units, the quotient rounded down,
// and code 255 is infinity: sixteen steps an octave, from a unit to nearly four times all bins.
struct ErrorCode {
  // The least code whose value is at least `units` (>= 0, not NaN).
  static std::uint8_t encodeUp(float units) {
    if (!(units > 0)) return 0;
    if (units <= 17.0f / 16) return 1;
    // Exponent and four bits of mantissa; what is behind them rounds up.
    const std::uint32_t bits = std::bit_cast<std::uint32_t>(units) - (127u << 23);
    return static_cast<std::uint8_t>(std::min(255u, (bits + ((1u << 19) - 1)) >> 19));
  }
  static constexpr double decode(std::uint8_t code) {
    if (code == 0) return 0;
    if (code == 255) return std::numeric_limits<double>::infinity();
    return (1 + (code & 15) / 16.0) * static_cast<double>(std::uint64_t{1} << (code >> 4));
  }
  // The greatest code whose value is at most `units`; nothing is, where they are negative.
  static int greatestWithin(double units) {
    int code = 255;
    while (code >= 0 && !(decode(static_cast<std::uint8_t>(code)) <= units)) --code;
    return code;
  }
};

// Which bins a tile stores: those that its range touches, one after the other, behind one for all
// others together.
struct TileBins {
  std::uint32_t first, count;

  TileBins(const ErrorBins& bins, const ValueRange& range)
      : first(bins.binOf(static_cast<double>(range.min))),
        count(bins.binOf(static_cast<double>(range.max)) - first + 1) {}
  // Blocks of codes, one for each cell of the tile, that it has.
  std::uint32_t blocks() const { return count + 1; }
  std::uint32_t blockOf(std::uint32_t bin) const {
    return bin < first || bin >= first + count ? 0 : bin - first + 1;
  }
};

}  // namespace isobrick
