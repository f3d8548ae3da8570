// A cell of a volume, its gradient, and the curvature of its isosurfaces (Eq. 2).
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>

namespace isobrick::test {

// In double precision, with nothing taken from the libraries.
struct TrilinearCell {
  std::array<double, 8> corners;  // x fastest

  static double blend(double t, int side) { return side == 1 ? t : 1 - t; }
  static double slope(int side) { return side == 1 ? 1 : -1; }
  template <typename X, typename Y, typename Z>
  double sum(X&& x, Y&& y, Z&& z) const {
    double result = 0;
    for (int i = 0; i < 8; ++i)
      result += corners[static_cast<std::size_t>(i)] * x(i & 1) * y(i >> 1 & 1) * z(i >> 2);
    return result;
  }
  double value(const glm::dvec3& p) const {
    return sum([&](int s) { return blend(p.x, s); }, [&](int s) { return blend(p.y, s); },
               [&](int s) { return blend(p.z, s); });
  }
  glm::dvec3 gradient(const glm::dvec3& p) const {
    const auto bx = [&](int s) { return blend(p.x, s); };
    const auto by = [&](int s) { return blend(p.y, s); };
    const auto bz = [&](int s) { return blend(p.z, s); };
    return {sum(slope, by, bz), sum(bx, slope, bz), sum(bx, by, slope)};
  }
  // Eq. 2, in 1/voxel^2: the squared Frobenius norm of the tangential Hessian over |g|^2, which is
  // kappa1^2 + kappa2^2; then / 4. The gradient must not vanish.
  double totalCurvatureAt(const glm::dvec3& p) const {
    const auto bx = [&](int s) { return blend(p.x, s); };
    const auto by = [&](int s) { return blend(p.y, s); };
    const auto bz = [&](int s) { return blend(p.z, s); };
    const double xy = sum(slope, slope, bz), xz = sum(slope, by, slope), yz = sum(bx, slope, slope);
    const glm::dvec3 g = gradient(p);
    const double length = glm::length(g);
    const glm::dvec3 n = g / length;
    const glm::dvec3 hn(xy * n.y + xz * n.z, xy * n.x + yz * n.z, xz * n.x + yz * n.y);
    const double nhn = glm::dot(n, hn);
    // |PHP|^2 = |H|^2 - 2 |Hn|^2 + (n'Hn)^2 with P = I - n n'.
    const double h2 = 2 * (xy * xy + xz * xz + yz * yz);
    return std::max(0.0, h2 - 2 * glm::dot(hn, hn) + nhn * nhn) / (4 * length * length);
  }
};

}  // namespace isobrick::test
