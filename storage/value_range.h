// The least and the greatest value of something.
#pragma once

#include <algorithm>
#include <limits>

namespace isobrick {

// Closed interval; empty until something was included. Every voxel type fits float exactly.
struct ValueRange {
  float min = std::numeric_limits<float>::infinity();
  float max = -std::numeric_limits<float>::infinity();

  bool operator==(const ValueRange&) const = default;
  void include(float v) {
    min = std::min(min, v);
    max = std::max(max, v);
  }
  void include(const ValueRange& other) {
    min = std::min(min, other.min);
    max = std::max(max, other.max);
  }
  // True where values on both sides of the isovalue occur; a value equal to it is inside.
  bool crosses(float isovalue) const { return min < isovalue && max >= isovalue; }
};

}  // namespace isobrick
