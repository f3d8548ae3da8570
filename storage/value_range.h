// The least and the greatest value of something, and which voxels an isovalue has inside.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <type_traits>

namespace isobrick {

// Closed interval; empty until something was included. Every voxel type fits float exactly.
struct ValueRange {
  float min = std::numeric_limits<float>::infinity();   // the least value
  float max = -std::numeric_limits<float>::infinity();  // the greatest value

  bool operator==(const ValueRange&) const = default;
  // Grows to hold a value.
  void include(float v) {
    min = std::min(min, v);
    max = std::max(max, v);
  }
  // Grows to hold another range.
  void include(const ValueRange& other) {
    min = std::min(min, other.min);
    max = std::max(max, other.max);
  }
  // True where values on both sides of the isovalue occur; a value equal to it is inside.
  bool crosses(float isovalue) const { return min < isovalue && max >= isovalue; }
};

// The least voxel that is inside: v >= isovalue exactly where v >= the threshold. None where no
// voxel of the type is. T: a voxel type.
template <typename T>
std::optional<T> insideThreshold(float isovalue) {
  if constexpr (std::is_floating_point_v<T>) {
    return isovalue;
  } else {
    const float least = std::ceil(isovalue);
    if (least > static_cast<float>(std::numeric_limits<T>::max())) return std::nullopt;
    if (least < static_cast<float>(std::numeric_limits<T>::lowest()))
      return std::numeric_limits<T>::lowest();
    return static_cast<T>(least);
  }
}

}  // namespace isobrick
