// One byte for a Bernstein coefficient of the curvature bound (rule 4), never smaller than the
// coefficient itself.
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <limits>

namespace isobrick {

// Code 0 is exactly 0, code c in 1 .. 254 is 2^((c - 176) / 8), code 255 is infinity: eight steps
// an octave (at most 9 % above the value) from a sphere's radius of 1,400 voxels to 0.024.
struct CurvatureCode {
  static constexpr int kStepsPerOctave = 8;
  static constexpr int kCodeOfOne = 176;
  // 2^(i / 8), rounded to float: the mantissas of all codes.
  static constexpr std::array<float, kStepsPerOctave> kOctave = {
      0x1p+0f,        0x1.172b84p+0f, 0x1.306fep+0f,  0x1.4bfdaep+0f,
      0x1.6a09e6p+0f, 0x1.8ace54p+0f, 0x1.ae89fap+0f, 0x1.d5818ep+0f};

  static constexpr float decode(std::uint8_t code) { return kValues[code]; }

  // The smallest code with decode(code) >= value; `value` >= 0, in 1/voxel^2. NaN gives 255: no
  // bound is known.
  static constexpr std::uint8_t encodeUp(double value) {
    if (value != value) return 255;
    if (!(value > 0)) return 0;
    // value = mantissa * 2^exponent, by its bits; subnormal values are below code 1 anyway.
    const auto bits = std::bit_cast<std::uint64_t>(value);
    const int exponent = static_cast<int>(bits >> 52) - 1023;
    const auto mantissa = std::bit_cast<double>((bits & ((1ull << 52) - 1)) | 1023ull << 52);
    int code = kStepsPerOctave * exponent + kCodeOfOne;
    for (const float step : kOctave) code += mantissa > static_cast<double>(step);
    return static_cast<std::uint8_t>(code < 1 ? 1 : code > 255 ? 255 : code);
  }

 private:
  static constexpr std::array<float, 256> makeValues() {
    std::array<float, 256> values{};
    for (int code = 1; code < 255; ++code) {
      // kOctave times a power of two, which is exact.
      const int octave = code / kStepsPerOctave;
      const int exponent = octave - kCodeOfOne / kStepsPerOctave;
      const auto power = std::bit_cast<float>(static_cast<std::uint32_t>(exponent + 127) << 23);
      values[static_cast<std::size_t>(code)] =
          kOctave[static_cast<std::size_t>(code % kStepsPerOctave)] * power;
    }
    values[255] = std::numeric_limits<float>::infinity();
    return values;
  }
  static const std::array<float, 256> kValues;
};
inline constexpr std::array<float, 256> CurvatureCode::kValues = CurvatureCode::makeValues();
static_assert(CurvatureCode::kCodeOfOne % CurvatureCode::kStepsPerOctave == 0);

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
