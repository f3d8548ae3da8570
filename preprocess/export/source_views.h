// Volumes that are made of another volume as it is read: a box of it, or its values mapped to
// another type.
#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// The voxels of `box`, which lies in the volume and has at least two along every axis; throws Error
// otherwise. Positions in the world stay the same.
std::unique_ptr<VolumeSource> makeCroppedSource(std::unique_ptr<VolumeSource> source,
                                                const IndexBox& box);

// Values as float32, which holds those of every voxel type without loss.
std::unique_ptr<VolumeSource> makeFloatSource(std::unique_ptr<VolumeSource> source);

// What becomes of values that are written in a type which does not hold them all. Any number of
// threads adds to it.
class ValueLoss {
 public:
  void add(std::uint64_t changed, double most_change, const RealRange& range);
  std::uint64_t changed() const { return changed_; }
  double mostChange() const { return most_change_; }
  // "12 values changed as float32, by at most 0.004 of a range of 12".
  std::string text() const;
  // Of the values that were written.
  double range() const { return greatest_ - least_; }

 private:
  mutable std::mutex mutex_;
  std::uint64_t changed_ = 0;
  double most_change_ = 0;
  double least_ = std::numeric_limits<double>::infinity();
  double greatest_ = -std::numeric_limits<double>::infinity();
};

// The input's values (VolumeInfo::values), in a type that holds them: of all types, or of those
// that pyramids hold, which may lose something; `loss` counts that.
std::unique_ptr<VolumeSource> makeRealSource(std::unique_ptr<VolumeSource> source,
                                             bool has_all_types, std::shared_ptr<ValueLoss> loss);

// Values from `low` to `high` spread over all of an integer type: `low` becomes its least number,
// `high` its greatest, values outside become the nearer of the two; rounded to the nearest. A note
// states the step that is lost. Throws Error unless low < high, and for float32.
struct ValueWindow {
  double low = 0, high = 0;
};
std::unique_ptr<VolumeSource> makeWindowedSource(std::unique_ptr<VolumeSource> source,
                                                 const ValueWindow& window, VoxelType type);

// The indicator of a label: 1 where a voxel is this number and 0 elsewhere, as uint8. Compared as
// the integers that they are, of 64 bits too: `source` delivers its numbers as the file has them
// (OpenOptions::keep_numbers). Throws Error if they are no integers.
std::unique_ptr<VolumeSource> makeLabelSource(std::unique_ptr<VolumeSource> source,
                                              std::uint64_t label);

// The same voxels with these lengths in place of the source's, and notes that say so. Throws Error
// for numbers that no volume can have, for words that are no unit, and for a unit in place of
// several.
std::unique_ptr<VolumeSource> makePlacedSource(std::unique_ptr<VolumeSource> source,
                                               const GivenPlace& given);

}  // namespace isobrick
