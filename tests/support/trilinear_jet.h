// Eq. 2 at one point of a trilinear cell, and the points at which the bound is fitted, written
// plainly: what the kernel of the curvature bound is compared with.
#pragma once

#include <array>
#include <cstdint>

namespace isobrick::test {

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

constexpr std::array<std::array<std::uint8_t, 3>, kCellSamples> makeSamplePoints() {
  std::array<std::array<std::uint8_t, 3>, kCellSamples> points{};
  std::size_t n = 0;
  for (std::uint8_t z = 0; z < 3; ++z)
    for (std::uint8_t y = 0; y < 3; ++y)
      for (std::uint8_t x = 0; x < 3; ++x)
        if ((x == 1) + (y == 1) + (z == 1) <= 1) points[n++] = {x, y, z};
  return points;
}
// Coordinates of those points in half cells, 0 .. 2.
inline constexpr auto kCellSamplePoints = makeSamplePoints();

}  // namespace isobrick::test
