// A low-pass of level 0 that does not shrink what it smooths (Point 3 of docs/ALGORITHM.md,
// "Smoothing").
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace isobrick {

// One axis of the separable, symmetric kernel 2 G - G * G, where G is a Gaussian of `sigma` samples
// that is cut at 2.5 sigma and sums to 1: element k is the weight of the two samples at the
// distance k + 1, and what is left to 1 that of the sample itself. Second moments vanish whatever G
// is, so polynomials of degree 3, and spheres in a field of distances, stay where they are. `sigma`
// above 0.
std::vector<float> smoothingWeights(double sigma);

// Smooths `count` samples along one axis:
//   out[i] = center[i] + sum over k of weights[k] * (pairs[2k][i] + pairs[2k+1][i] - 2 center[i])
// in single precision, k ascending. `pairs` are the samples at the distance k + 1 on both sides; at
// a border there are fewer pairs than weights. So constants are exact, and linear fields up to
// their borders. A pair with a sample that is not finite does not count, and what is not finite
// stays. T: a voxel type.
template <typename T>
void smoothAcross(const T* center, std::span<const T* const> pairs, const float* weights,
                  std::size_t count, float* out);

// The same along x, for a whole row.
void smoothRow(const float* row, std::span<const float> weights, std::size_t count, float* out);

}  // namespace isobrick
