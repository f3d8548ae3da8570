// The curvature bound as it is stored: how far level 1 lies from level 0, in voxels, as a function
// of the isovalue (rule 4; docs/FORMAT.md, sections 7 and 8).
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>

#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/voxel_type.h"

namespace isobrick {

// One byte for a distance in voxels, never smaller than the distance: code 0 is 0, the codes from 1
// on are 2^-10 times 1, 5/4, 6/4, 7/4, 2, ..., four an octave, 255 is infinity.
struct DeviationCode {
  static constexpr int kStepsPerOctave = 4;
  static constexpr int kLeastExponent = -10;
  // The greatest finite code that is written, eight voxels; what is farther counts as infinity.
  static constexpr int kMost = 1 + (3 - kLeastExponent) * kStepsPerOctave;

  static constexpr float decode(std::uint8_t code) {
    if (code == 0) return 0;
    if (code == 255) return std::numeric_limits<float>::infinity();
    return std::bit_cast<float>(kBitsOfOne + ((code - 1u) << kShift));
  }
  // The smallest code with decode(code) >= distance, which is at least 0; NaN gives 255.
  static constexpr std::uint8_t encodeUp(float distance) {
    if (!(distance <= decode(kMost))) return 255;
    if (!(distance > 0)) return 0;
    const auto bits = std::bit_cast<std::uint32_t>(distance);
    if (bits <= kBitsOfOne) return 1;
    return static_cast<std::uint8_t>(1 + ((bits - kBitsOfOne + (1u << kShift) - 1) >> kShift));
  }

 private:
  // A float's bits above its last 21 count quarters of octaves.
  static constexpr int kShift = 21;
  static constexpr std::uint32_t kBitsOfOne = static_cast<std::uint32_t>(127 + kLeastExponent)
                                              << 23;
};

// Coefficients of a block of cells: what they bound is linear between the middles of as many equal
// parts of the block's range, and constant before the first and behind the last.
inline constexpr int kDeviationCoefficients = 8;

// The bound for the isosurface of `isovalue`, in voxels. An infinite coefficient bounds by infinity
// wherever it has a weight.
inline float deviationBound(const std::uint8_t codes[kDeviationCoefficients],
                            const ValueRange& range, float isovalue) {
  constexpr double kLast = kDeviationCoefficients - 1;
  const double width = static_cast<double>(range.max) - range.min;
  const double t = width > 0 ? (static_cast<double>(isovalue) - range.min) / width : 0.0;
  const double at = t * kDeviationCoefficients - 0.5;
  if (!(at > 0)) return DeviationCode::decode(codes[0]);
  if (at >= kLast) return DeviationCode::decode(codes[kDeviationCoefficients - 1]);
  const int j = static_cast<int>(at);
  const double weight = at - j;
  const double low = static_cast<double>(DeviationCode::decode(codes[j]));
  if (weight == 0) return static_cast<float>(low);
  const double high = static_cast<double>(DeviationCode::decode(codes[j + 1]));
  return static_cast<float>(low * (1 - weight) + high * weight);
}

// The range of a block of BrickLayout::brickCurvatureBlocks(brick): that of its tiles, which are
// among the `tiles` of the brick, layout.brickTiles(0, brick) of them.
inline ValueRange curvatureBlockRange(const BrickLayout& layout, const Index3& brick,
                                      std::span<const ValueRange> tiles, const Index3& block) {
  const Index3 all = layout.brickTiles(0, brick);
  const std::int64_t edge = layout.curvatureCells() / layout.tileCells();
  const Index3 first = edge * block;
  ValueRange range;
  forEachIndex({first, glm::min(Index3(edge), all - first)}, [&](const Index3& tile) {
    range.include(tiles[static_cast<std::size_t>(linearIndex(tile, all))]);
  });
  return range;
}

// The bound of a sphere whose total curvature (Eq. 2), 1 / (2 radius^2) in 1/voxel^2, is
// `curvature`: low-pass and interpolation move it by 1.25 / radius voxels or less at three quarters
// of the samples, and codes add up to a fifth.
inline double deviationOfSphere(double curvature) { return 1.5 * std::sqrt(2 * curvature); }

}  // namespace isobrick
