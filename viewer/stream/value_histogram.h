// How often each value occurs, and how large the isosurface of each is.
#pragma once

#include <cstddef>
#include <vector>

#include "isobrick/storage/pyramid.h"

namespace isobrick {

struct ValueHistogram {
  double least = 0.0, greatest = 1.0;  // data units, of level 0
  std::vector<double> counts;          // of voxels, in equal parts of that range

  // The contour spectrum (Bajaj, Pascucci and Schikore 1997): lattice edges of level 0 that the
  // isovalue in the middle of each part crosses, about; empty: not known.
  std::vector<double> edges;

  std::vector<double> isovalues;  // that are suggested, the best one first

  double total() const;
  // About how many edges of level 0 the isosurface crosses; 0 if that is not known.
  double edgesAt(double isovalue) const;
  // And how many triangles it has there: two to an edge.
  double trianglesAt(double isovalue) const { return 2.0 * edgesAt(isovalue); }
};

// From the histogram and the gradients that the pyramid has, which throw Error if they are damaged.
ValueHistogram histogramOf(const Pyramid& pyramid, std::size_t bins = 256);

}  // namespace isobrick
