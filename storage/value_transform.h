// From the numbers that a pyramid stores to the values of its input.
#pragma once

#include <cmath>

namespace isobrick {

// Strictly increasing, so that comparisons and ranges hold for both.
struct ValueTransform {
  double scale = 1;   // finite, above 0
  double offset = 0;  // finite

  bool operator==(const ValueTransform&) const = default;
  // True if both are the same.
  bool isIdentity() const { return scale == 1 && offset == 0; }
  // The value of a stored number.
  double real(double stored) const { return stored * scale + offset; }
  // The number that would be stored for a value, before it is rounded to a voxel type.
  double stored(double real) const { return (real - offset) / scale; }
  // True for the numbers that are permitted.
  bool isSane() const { return std::isfinite(scale) && scale > 0 && std::isfinite(offset); }
};

// The least and the greatest value of a volume, in the values of its input.
struct RealRange {
  double min = 0;  // the least value
  double max = 0;  // the greatest value
};

}  // namespace isobrick
