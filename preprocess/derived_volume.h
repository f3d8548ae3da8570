// What is made of a volume before its surface is: the indicator of a label, a smoothed field.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// How far smoothing moved a surface. At every crossing of the surface with an edge of the voxels,
// as it was, this is the change of the value over the gradient of the smoothed field: the distance
// to the smoothed surface, to first order. Lengths are voxels of the least spacing.
struct SurfaceShift {
  double isovalue = 0;          // of the surface, in the values of the input
  std::uint64_t crossings = 0;  // whose surface is near them still
  double sum = 0;               // of their distances
  double most = 0;              // the largest of them
  std::uint64_t gone = 0;       // crossings with no smoothed surface within 2 sigma, or 1

  // Of the distances; 0 if there is no crossing.
  double mean() const { return crossings > 0 ? sum / static_cast<double>(crossings) : 0; }
};

// What is made of a volume, in this order.
struct Derivation {
  // 1 where a voxel is exactly this number, and 0 elsewhere, as uint8. Of integers alone, up to
  // 2^64 - 1.
  std::optional<std::uint64_t> label;
  // Smooths with this sigma, in voxels along each axis, above 0 and at most kMostSigma: the result
  // is float32. 0: not at all. A volume is then read in order, never in boxes, and holds some
  // 5 sigma + 8 slices.
  double denoise = 0;
  // If not null, and `denoise` is set, is filled while the volume is read: complete behind its last
  // row, and begun again each time that the volume is opened. Changes nothing else.
  std::shared_ptr<std::vector<SurfaceShift>> shifts = {};

  static constexpr double kMostSigma = 10;  // voxels
  // True if the volume stays as it is.
  bool isNone() const { return !label && denoise == 0; }
};

// True if derivedVolume() wants a source that delivers all numbers as the file has them
// (OpenOptions::keep_numbers); otherwise it wants voxels (value_fit.h).
inline bool takesNumbers(const Derivation& derivation) { return derivation.label.has_value(); }

// The derived volume, whose VolumeInfo::encoding and identity() say how it was made; or the source
// itself if the derivation is none. Throws Error for a label of voxels that are no integers.
std::unique_ptr<VolumeSource> derivedVolume(std::unique_ptr<VolumeSource> source,
                                            const Derivation& derivation);

}  // namespace isobrick
