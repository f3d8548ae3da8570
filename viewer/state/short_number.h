// Numbers as people read them in pictures.
#pragma once

#include <array>
#include <cmath>
#include <cstdio>
#include <string>

namespace isobrick {

// Four digits, and all of those before the point: 0.1235, 112.2, 65535.
inline std::string shortNumber(double value) {
  const double size = std::abs(value);
  const bool is_long = size >= 1e4 && size < 1e15;
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), is_long ? "%.0f" : "%.4g", value);
  return text.data();
}

}  // namespace isobrick
