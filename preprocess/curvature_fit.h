// The curvature bound of a cell of level 1 (Sect. 5.2 of the paper; rule 4 of the design).
#pragma once

#include <array>
#include <cstdint>

#include "storage/value_range.h"

namespace isobrick {

// First and second derivatives of a trilinear function at one point, in values per voxel and per
// voxel^2; its pure second derivatives vanish.
template <typename Real>
struct TrilinearJet {
  Real fx, fy, fz;
  Real fxy, fxz, fyz;

  Real gradientSquared() const { return fx * fx + fy * fy + fz * fz; }
};

// Total curvature (kappa1^2 + kappa2^2) / 4 of the isosurface through the point (Eq. 2), in
// 1/voxel^2. The gradient must not vanish.
template <typename Real>
Real totalCurvature(const TrilinearJet<Real>& j) {
  const Real a = j.fx * j.fyz, b = j.fy * j.fxz, c = j.fz * j.fxy;
  const Real g2 = j.gradientSquared();
  const Real mean = j.fx * j.fy * j.fxy + j.fx * j.fz * j.fxz + j.fy * j.fz * j.fyz;
  return (mean * mean / g2 + (a * a + b * b + c * c) / 2 - (a * b + a * c + b * c)) / (g2 * g2);
}

// The points of a trilinear cell at which the bound is fitted: its 8 corners and the midpoints of
// its 12 edges. Marching cubes puts vertices on edges only (Sect. 5.2).
inline constexpr int kCellSamples = 20;
// Coordinates of those points in half cells, 0 .. 2.
const std::array<std::array<std::uint8_t, 3>, kCellSamples>& cellSamplePoints();

// Quadratic Bernstein coefficients b0, b1, b2 over a range of values.
using BernsteinCoefficients = std::array<float, 3>;

// Number of nodes that fitCurvature treats at once (SIMD lanes).
inline constexpr int kFitLanes = 16;

// Values of the 3x3x3 voxels of kFitLanes cells of level 1, voxel by voxel (x fastest); a node
// with one cell along an axis repeats its last voxels: cells of zero extent, whose samples are
// those of the border face and can only raise the bound.
using FitBlock = std::array<std::array<float, kFitLanes>, 27>;

// For every lane: coefficients with p(v_i) >= k_i for all samples of its eight cells whose gradient
// is at least `epsilon` times the width of the lane's range, by the update of Sect. 5.2: minimal in
// the least squares sense, only ever upward. Zero where no sample counts.
void fitCurvature(const FitBlock& block, const std::array<ValueRange, kFitLanes>& ranges,
                  float epsilon, std::array<BernsteinCoefficients, kFitLanes>& result);

}  // namespace isobrick
