// The error bound of rule 15, slowly: of single cells, and of a mesh that was made.
#pragma once

#include <string>
#include <vector>

#include "tests/support/reference_mesher.h"

namespace isobrick::test {

// The error of a cell of level 1 for an isovalue, in the units of the data: the least tolerance for
// which it may be a leaf. Below 0 where nothing there crosses the isovalue.
double referenceError(const ReferencePyramid& pyramid, double isovalue, const Index3& cell);

// What the stored bounds of levels 2 and more bound, for one isovalue: for every cell of `level`, x
// fastest, the greatest of its own error, as a leaf, and of those of all finer cells that touch it,
// which may hang on a coarser leaf. Slow: for small volumes.
std::vector<double> referenceLeafErrors(const ReferencePyramid& pyramid, int level,
                                        double isovalue);

// What a tolerance promises, of the mesh itself: every vertex on an edge lies where level 0,
// interpolated along its edge, is within the tolerance of the isovalue, but for how far rule 8 may
// move it; every voxel beyond isovalue -+ tolerance lies on its own side in the field of every leaf
// that touches it. Says what is wrong, or nothing.
std::string brokenPromise(const ReferencePyramid& pyramid, const ReferenceMesh& mesh,
                          double isovalue, double tolerance);

}  // namespace isobrick::test
