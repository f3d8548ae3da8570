#include "preprocess/curvature_fit.h"

#include <algorithm>
#include <cmath>

namespace isobrick {
namespace {

// Rounding of the single-precision arithmetic below; the coded coefficients are steps of 9 %.
constexpr float kRoundingMargin = 1.0f + 1e-4f;

constexpr std::array<std::array<std::uint8_t, 3>, kCellSamples> makeSamplePoints() {
  std::array<std::array<std::uint8_t, 3>, kCellSamples> points{};
  std::size_t n = 0;
  for (std::uint8_t z = 0; z < 3; ++z)
    for (std::uint8_t y = 0; y < 3; ++y)
      for (std::uint8_t x = 0; x < 3; ++x)
        if ((x == 1) + (y == 1) + (z == 1) <= 1) points[n++] = {x, y, z};
  return points;
}
constexpr auto kSamplePoints = makeSamplePoints();

using Lanes = std::array<float, kFitLanes>;

struct LaneState {
  Lanes b0{}, b1{}, b2{};
  Lanes to_unit;                 // from scaled values to 0 .. 1 over the range
  Lanes least_gradient_squared;  // in scaled values
};

// Raises the coefficients of all lanes for the sample point `point` of the cell whose lowest voxel
// is `cell` (0 or 1 per axis). Branch-free, so that the compiler makes SIMD of the lanes.
void addSample(const FitBlock& block, const std::array<int, 3>& cell,
               const std::array<std::uint8_t, 3>& point, LaneState& s) {
  const auto voxel = [&](int x, int y, int z) -> const Lanes& {
    return block[static_cast<std::size_t>((cell[2] + z) * 9 + (cell[1] + y) * 3 + cell[0] + x)];
  };
  const Lanes &f000 = voxel(0, 0, 0), &f100 = voxel(1, 0, 0), &f010 = voxel(0, 1, 0),
              &f110 = voxel(1, 1, 0), &f001 = voxel(0, 0, 1), &f101 = voxel(1, 0, 1),
              &f011 = voxel(0, 1, 1), &f111 = voxel(1, 1, 1);
  const float x = 0.5f * point[0], y = 0.5f * point[1], z = 0.5f * point[2];
  for (std::size_t i = 0; i < kFitLanes; ++i) {
    // The trilinear form c0 + cx x + cy y + cz z + cxy xy + cxz xz + cyz yz + cxyz xyz.
    const float cx = f100[i] - f000[i], cy = f010[i] - f000[i], cz = f001[i] - f000[i];
    const float cxy = f110[i] - f100[i] - cy, cxz = f101[i] - f100[i] - cz;
    const float cyz = f011[i] - f010[i] - cz;
    const float cxyz = f111[i] - f110[i] - f101[i] + f100[i] - cyz;
    const TrilinearJet<float> jet = {cx + cxy * y + cxz * z + cxyz * y * z,
                                     cy + cxy * x + cyz * z + cxyz * x * z,
                                     cz + cxz * x + cyz * y + cxyz * x * y,
                                     cxy + cxyz * z,
                                     cxz + cxyz * y,
                                     cyz + cxyz * x};
    const float v = f000[i] + cx * x + cy * y + cz * z + cxy * x * y + cxz * x * z + cyz * y * z +
                    cxyz * x * y * z;
    const float g2 = jet.gradientSquared();
    const bool counts = g2 >= s.least_gradient_squared[i] && g2 > 0;
    const float k = totalCurvature(jet) * kRoundingMargin;

    const float t = std::min(1.0f, std::max(0.0f, v * s.to_unit[i]));
    const float u = 1 - t;
    const float basis0 = u * u, basis1 = 2 * t * u, basis2 = t * t;
    const float p = s.b0[i] * basis0 + s.b1[i] * basis1 + s.b2[i] * basis2;
    const float delta = counts && k > p ? k - p : 0.0f;
    const float step = delta / (basis0 * basis0 + basis1 * basis1 + basis2 * basis2);
    s.b0[i] += step * basis0;
    s.b1[i] += step * basis1;
    s.b2[i] += step * basis2;
  }
}

}  // namespace

const std::array<std::array<std::uint8_t, 3>, kCellSamples>& cellSamplePoints() {
  return kSamplePoints;
}

void fitCurvature(const FitBlock& block, const std::array<ValueRange, kFitLanes>& ranges,
                  float epsilon, std::array<BernsteinCoefficients, kFitLanes>& result) {
  // Curvature does not depend on the unit of the values: counted from the range's lower end and
  // scaled by a power of two to at most 1, single precision neither overflows nor underflows, and
  // what is linear stays exactly so.
  FitBlock scaled;
  LaneState state;
  for (std::size_t i = 0; i < kFitLanes; ++i) {
    const auto low = static_cast<double>(ranges[i].min);
    const double width = static_cast<double>(ranges[i].max) - low;
    int exponent = 0;
    const double part =
        std::frexp(width, &exponent);  // width = part * 2^exponent, part in [1/2, 1)
    const double scale = width > 0 ? std::ldexp(1.0, -exponent) : 0;
    state.to_unit[i] = width > 0 ? static_cast<float>(1 / part) : 0.0f;
    const auto least = static_cast<float>(static_cast<double>(epsilon) * part);
    state.least_gradient_squared[i] = least * least;
    for (std::size_t voxel = 0; voxel < block.size(); ++voxel)
      scaled[voxel][i] = static_cast<float>((static_cast<double>(block[voxel][i]) - low) * scale);
  }
  for (int cell = 0; cell < 8; ++cell)
    for (const auto& point : kSamplePoints)
      addSample(scaled, {cell & 1, (cell >> 1) & 1, cell >> 2}, point, state);
  for (std::size_t i = 0; i < kFitLanes; ++i) result[i] = {state.b0[i], state.b1[i], state.b2[i]};
}

}  // namespace isobrick
