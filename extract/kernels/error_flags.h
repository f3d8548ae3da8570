// Where the surface of leaves of level 1 would leave the tolerance: the error of rule 15, as flags
// of voxels and edges of level 0.
#pragma once

#include <cstdint>
#include <vector>

namespace isobrick {

// A row of voxels along x, and between which bounds the field of the leaves of level 1 that touch
// them may lie there: any mixture of the values that their corners can have (rule 6).
struct BoundedRow {
  const float* value;
  const float* low;
  const float* high;
};

// Bits of a flag.
enum ErrorFlag : std::uint8_t {
  // The voxel may come to the wrong side although it lies beyond the tolerance.
  kWrongSide = 1,
  // On the edge to the next voxel the surface may cross where the voxels' own value, interpolated,
  // is beyond the tolerance: where both ends have coarse values,
  kCoarseEdge = 2,
  // and where only the lower, or only the higher end has.
  kLowHangs = 4,
  kHighHangs = 8,
};

// What the errors are compared with. Both must be finite.
struct ErrorBound {
  float isovalue;
  float tolerance;  // less what rounding may add; negative: every crossing is too much
};

// kWrongSide of `count` voxels. `flags` gets one byte each; like the arrays of the row, and `other`
// below, it has room for kErrorLanes more, which are read and written too.
void flagVoxels(const BoundedRow& row, std::int64_t count, const ErrorBound& bound,
                std::uint8_t* flags);

// The other flags of the edges from each of `count` voxels to the voxel of the same number in
// `other`, another row or this one a voxel further.
void flagEdges(const BoundedRow& row, const BoundedRow& other, std::int64_t count,
               const ErrorBound& bound, std::uint8_t* flags);

// Whether any of some edges, bit i being that from voxel i, has kCoarseEdge. No other flag is
// looked at.
bool hasCoarseEdge(const BoundedRow& row, const BoundedRow& other, std::uint32_t edges,
                   const ErrorBound& bound);

inline constexpr std::int64_t kErrorLanes = 64;

}  // namespace isobrick
