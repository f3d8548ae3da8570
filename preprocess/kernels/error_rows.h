// How far from level 0 a surface of coarser leaves may come, along a row of voxels (rule 15).
#pragma once

#include <cstdint>

namespace isobrick {

// A row of voxels along x, and between which bounds the field of coarser leaves may lie there.
struct BracketedRow {
  const float* value = nullptr;
  const float* low = nullptr;
  const float* high = nullptr;
};

// Bins of isovalues side by side. Bin i holds [least[i], greatest[i]]; a little of what the next
// ones hold may be in it. `first` + i * `width` is where they meet, to `room` (in bins).
struct IsovalueBins {
  const float* least;
  const float* greatest;
  float first, width, room;
  std::int64_t count;
};

// Where errors go: of each interval between two voxels of a row, and of each bin, the greatest that
// was met. That of interval x and bin i is at[i * row_stride + x]; at least kErrorRowPadding
// numbers lie before and behind each row. is_touched[i] is set where anything was.
struct GreatestErrors {
  float* at;
  std::uint8_t* is_touched;
};

// The rows of cells that have a row of voxels, and those that have the edges from it to the next
// row along y, and to the next slice along z.
struct ErrorTargets {
  GreatestErrors here[4], along_y[2], along_z[2];
  int here_count = 0, along_y_count = 0, along_z_count = 0;
  std::int64_t row_stride = 0;
};

// Of `count` voxels: for each bin, over its isovalues v, the greatest |value - v|
//   - of a voxel that may come to the wrong side of v,
//   - where the coarse field may cross v on an edge that leads up from a voxel, along x to the next
//     one, to that of the next row or of the next slice,
// or more, goes to the intervals that have the voxel or edge. Where next_y or next_z is null there
// are no such edges. The rows have room for kErrorRowPadding more voxels, which are read; what is
// read must be finite.
void includeErrorsOfRow(const BracketedRow& here, const BracketedRow& next_y,
                        const BracketedRow& next_z, std::int64_t count, const IsovalueBins& bins,
                        const ErrorTargets& targets);

inline constexpr std::int64_t kErrorRowPadding = 64;

}  // namespace isobrick
