// How steep the voxels of level 0 are along the isosurface of every value.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "isobrick/storage/grid.h"

namespace isobrick {

// Lattice edges of level 0 whose two voxels differ, by the values between these two. The area of an
// isovalue is how many edges it crosses, its gradient the sum of their differences: gradient over
// area is the mean gradient along the isosurface (Pekar, Wiebel and Hege, "Fast detection of
// meaningful isosurfaces for volume data visualization", 2001; area and gradient as functions of
// the isovalue are the contour spectrum of Bajaj, Pascucci and Schikore, 1997). Both are estimates
// of the whole volume's, as means over parts of equal width of the values.
struct GradientSpectrum {
  struct Edges {
    std::vector<float> area, gradient;  // one for each part
  };

  float first = 0, width = 1;  // part i has the values from first + i width on
  // Edges that end at the least, and at the greatest voxel: how many there are along x, y and z.
  std::array<float, 3> at_least{}, at_greatest{};
  // Edges that end at neither, at the least, and at the greatest. An edge that ends at both counts
  // for the one that is further from the other values.
  Edges inner, least, greatest;

  std::size_t parts() const { return inner.area.size(); }
};

// How many parts a volume of so many voxels has.
std::size_t gradientParts(const Index3& voxels);

// The stored numbers: docs/FORMAT.md has the order.
constexpr std::size_t gradientElements(std::size_t parts) { return 8 + 6 * parts; }
std::vector<float> elementsOf(const GradientSpectrum& spectrum);
// Nothing if a number is not finite, a sum is negative, or the width is not positive.
std::optional<GradientSpectrum> gradientSpectrumOf(std::span<const float> elements);

}  // namespace isobrick
