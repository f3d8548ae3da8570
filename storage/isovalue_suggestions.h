// Suggested isovalues for a volume that is new to the user.
#pragma once

#include <optional>
#include <vector>

#include "isobrick/storage/pyramid.h"
#include "isobrick/storage/voxel_histogram.h"

namespace isobrick {

struct GradientSpectrum;  // storage/gradient_spectrum.h

// A suggested isovalue.
struct IsovalueSuggestion {
  double value = 0;     // in the units of the voxels, with few digits
  double area = 0;      // lattice edges of level 0 that it crosses, estimated; 0: not known
  double gradient = 0;  // their mean difference, in the units of the voxels; 0: not known
};

// The suggestions for a volume.
struct IsovalueSuggestions {
  // At most kMost. The first one is between the object and its surroundings; the others follow by
  // the gradient along the whole isosurface. Empty only if all voxels are equal.
  std::vector<IsovalueSuggestion> values;
  // The least voxel, if it is no data: it fills the unscanned part.
  std::optional<double> padding_least;
  // The greatest voxel, likewise.
  std::optional<double> padding_greatest;

  static constexpr std::size_t kMost = 4;  // of `values`
};

// A material is a value around which the volume is flat: the mean gradient along the isosurface
// (gradient_spectrum.h), with voxels that have equal neighbours taken in, has a valley there, and
// enough voxels lie in it. A suggestion is the value half-way between two materials that follow
// each other, outside the noise of both. Above the last material, or below the first, the centre of
// the gradients replaces a second one, so that thin structures, which are no material, are found.
//
// The surroundings are the material of the least value that has a quarter as many voxels as the
// greatest. The value of many voxels at an end of the range is padding if the next values are far
// from it, there are materials without it, and it fills the part that a scanner leaves out: the
// same in all slices along an axis; further from all others than these are from each other; or
// below the Hounsfield units of a CT.
//
// Without a spectrum (files of earlier programs), or if it shows no material, the suggestion is the
// value that divides the voxels into two groups of least spread (Otsu), padding left out.
//
// `range` and `noise` are those of the voxels, as Pyramid::valueRange() and Pyramid::noise(); both,
// like the values that come out, are in the units of the voxels.
IsovalueSuggestions suggestIsovalues(const VoxelHistogram& histogram, const ValueRange& range,
                                     const std::optional<GradientSpectrum>& spectrum, double noise);

// The same for a pyramid. Throws Error if its histogram or its spectrum is damaged.
IsovalueSuggestions suggestIsovalues(const Pyramid& pyramid);

}  // namespace isobrick
