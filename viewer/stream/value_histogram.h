// How often which values occur, as it is drawn.
#pragma once

#include <cstddef>
#include <vector>

#include "isobrick/storage/pyramid.h"

namespace isobrick {

struct ValueHistogram {
  double least = 0.0, greatest = 1.0;  // data units, of level 0
  std::vector<double> counts;          // of voxels, in equal parts of that range

  double total() const;
  // The value that parts the voxels into two groups of the least spread (Otsu): a first isovalue.
  double dividingValue() const;
};

// From the histogram that the pyramid has: Pyramid::histogram(), which throws Error where it is
// damaged.
ValueHistogram histogramOf(const Pyramid& pyramid, std::size_t bins = 256);

}  // namespace isobrick
