// How often each value occurs, for drawing.
#pragma once

#include <cstddef>
#include <vector>

#include "isobrick/storage/pyramid.h"

namespace isobrick {

struct ValueHistogram {
  double least = 0.0, greatest = 1.0;  // data units, of level 0
  std::vector<double> counts;          // of voxels, in equal parts of that range

  std::vector<double> isovalues;  // that are suggested, the best one first

  double total() const;
};

// From the histogram and the gradients that the pyramid has, which throw Error if they are damaged.
ValueHistogram histogramOf(const Pyramid& pyramid, std::size_t bins = 256);

}  // namespace isobrick
