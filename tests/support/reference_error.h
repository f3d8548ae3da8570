// The error bound of rule 15, slowly: of single cells, and of a mesh that was made.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "tests/support/reference_mesher.h"

namespace isobrick::test {

// Which cells of level 1 a tolerance refines, one by one. Remembers what it has found.
class ReferenceTolerance {
 public:
  // The pyramid outlives the object.
  ReferenceTolerance(const ReferencePyramid& pyramid, double isovalue, double tolerance)
      : pyramid_(pyramid), isovalue_(isovalue), tolerance_(tolerance) {}

  // Whether it refines the cell: nothing where that hangs on an error so near to the tolerance that
  // single precision may see it on the other side.
  std::optional<bool> refines(const Index3& cell);

 private:
  enum class Kind { kWithin, kBeyondAmidstFine, kNotCrossed, kOpen };

  // True where the error is too near to the tolerance.
  bool isBeyond(double error);
  Kind kindOf(const Index3& cell);
  // An open cell whose corners that touch cells of these kinds have their samples of level 0.
  bool isOpenBeyond(const Index3& cell, bool beside_even);

  const ReferencePyramid& pyramid_;
  const double isovalue_, tolerance_;
  bool is_near_ = false;  // an error was, since it was last asked
  struct Known {
    Kind kind;
    bool is_near;
  };
  std::map<std::int64_t, Known> kinds_;
};

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
