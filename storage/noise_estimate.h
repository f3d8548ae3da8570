// How noisy the voxels of a pyramid are.
#pragma once

#include "isobrick/storage/pyramid.h"

namespace isobrick {

// The standard deviation of the voxels' noise, in their units, taken to be independent from voxel
// to voxel: of the second differences along x, which a smooth field hardly has, the median of the
// magnitudes, over 0.6745 sqrt(6), as it is for Gaussian noise. Triples of equal voxels do not
// count: they are background that was cut off, or saturated. 0 where all are such. Surfaces, which
// are few, hardly move a median; noise that a filter has smeared over several voxels is
// underestimated.
//
// Looks at some rows of up to 16 bricks of level 0, spread evenly over those that are not constant:
// the same ones each time. Throws Error where one cannot be read. Thread-safe.
double estimateNoise(const Pyramid& pyramid);

}  // namespace isobrick
