// One byte for a Bernstein coefficient of the curvature bound (rule 4), never smaller than the
// coefficient itself.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

namespace isobrick {

// Code 0 is exactly 0, code c in 1 .. 254 is 2^((c - 176) / 8), code 255 is infinity: eight steps
// an octave (at most 9 % above the value) from a sphere's radius of 1,400 voxels to 0.024.
struct CurvatureCode {
  static float decode(std::uint8_t code) { return table()[code]; }

  // The smallest code with decode(code) >= value; `value` >= 0, in 1/voxel^2.
  static std::uint8_t encodeUp(double value) {
    if (std::isnan(value)) return 255;  // no bound is known
    if (!(value > 0)) return 0;
    const double step = std::ceil(8.0 * std::log2(value) + 176.0);
    int code = step < 1 ? 1 : step > 255 ? 255 : static_cast<int>(step);
    // The logarithm may be off by a rounding either way; the table decides.
    while (code > 1 && static_cast<double>(table()[static_cast<std::size_t>(code) - 1]) >= value)
      --code;
    while (code < 255 && static_cast<double>(table()[static_cast<std::size_t>(code)]) < value)
      ++code;
    return static_cast<std::uint8_t>(code);
  }

 private:
  static const std::array<float, 256>& table() {
    static const std::array<float, 256> values = [] {
      std::array<float, 256> v{};
      for (int c = 1; c < 255; ++c)
        v[static_cast<std::size_t>(c)] = static_cast<float>(std::exp2((c - 176) / 8.0));
      v[255] = std::numeric_limits<float>::infinity();
      return v;
    }();
    return values;
  }
};

// The quadratic Bernstein polynomial p over [range_min, range_max] with three coded coefficients
// (Sect. 5.2 of the paper): an upper bound of the total curvature (Eq. 2) of the isosurface
// F = value inside one cell of level 1, in 1/voxel^2. Values outside the range are clamped to it.
// An infinite coefficient bounds by infinity wherever its basis function is not zero.
inline float curvatureBound(const std::uint8_t coefficients[3], float range_min, float range_max,
                            float value) {
  const double width = static_cast<double>(range_max) - range_min;
  double t = width > 0 ? (static_cast<double>(value) - range_min) / width : 0.0;
  t = t < 0 ? 0 : t > 1 ? 1 : t;
  const double basis[3] = {(1 - t) * (1 - t), 2 * t * (1 - t), t * t};
  double sum = 0;
  for (int j = 0; j < 3; ++j)
    if (basis[j] > 0) sum += basis[j] * static_cast<double>(CurvatureCode::decode(coefficients[j]));
  return static_cast<float>(sum);
}

}  // namespace isobrick
