// How far from level 0 a surface of coarser leaves may come, along a row of voxels (rule 15).
#pragma once

#include <cstdint>

namespace isobrick {

// Voxels that are looked at together: for all bins that any of them touches, so longer runs have
// more to do. Rows have room for kErrorRowPadding more numbers, which are read; any finite ones.
inline constexpr std::int64_t kErrorRun = 16;
// A bit for each run of a row.
using RunBits = std::uint16_t;
inline constexpr std::int64_t kErrorRowPadding = 2 * kErrorRun;

// `count` numbers up to a whole run, and the padding.
constexpr std::int64_t errorRowStride(std::int64_t count) {
  return (count + kErrorRun - 1) / kErrorRun * kErrorRun + kErrorRowPadding;
}

// Bins of isovalues side by side. Bin i holds those from ends[i] to ends[i + 1]; what is asked lies
// between ends[0] and ends[count].
struct IsovalueBins {
  const float* ends;
  std::int64_t count;
};

// A run of bins, the last one included.
struct BinRun {
  std::uint16_t first, last;
};

// A row of voxels along x, and between which bounds the field of coarser leaves may lie there.
struct BracketedRow {
  const float* value = nullptr;
  const float* low = nullptr;
  const float* high = nullptr;
  // Of every kErrorRun voxels and the one behind them: the bins that their values and bounds touch.
  const BinRun* bins = nullptr;
};

// out[i] = from[i] + share * (to[i] - from[i])
void interpolateRow(const float* from, const float* to, float share, std::int64_t count,
                    float* out);

// A row of bounds between two others, on the way from one to the other.
struct RowBetween {
  const float *from_low, *to_low, *from_high, *to_high;
  float share;
  float slack;  // bounds are that much wider
  // Where not null, the bounds take in the voxels' values, and are nothing but these where 0.
  const float* is_between;
};

// The bounds of `count` voxels, and the bins of their runs.
void boundRow(const RowBetween& row, const float* value, std::int64_t count,
              const IsovalueBins& bins, float* low, float* high, BinRun* runs);

// A row of cells that errors go to: at[bin * row_stride + x] is the greatest of those that were met
// in voxel x and bin. Bit i of touched[bin] is set where run i met any. A row of cells has the
// edges that lead on from a row of voxels along y or z, or it has not.
struct ErrorTarget {
  float* at;
  RunBits* touched;
  bool has_y_edges, has_z_edges;
};
struct ErrorTargets {
  ErrorTarget rows[4];
  int count = 0;
  std::int64_t row_stride = 0;
  // Of 8 + kErrorRun voxels, from one at an end of cells on: 1 where cells end along x, 0 within.
  const float* is_end = nullptr;
  RunBits silent_runs = 0;  // bit i: nothing in run i has an error
};

// Of `count` voxels, the first at an end of cells: for each bin, over its isovalues v, the greatest
// |value - v|
//   - of a voxel that may come to the wrong side of v,
//   - where the coarse field may cross v on an edge that leads up from a voxel, along x to the next
//     one, to that of the next row or of the next slice,
// or more. What an edge along x has goes to the one of its voxels that lies within a cell. Where
// next_y or next_z has no values there are no such edges.
//
// Why it is so (docs/ALGORITHM.md, "Stored bounds"): as a function of v that is greatest at a voxel
// or where a bound crosses an end of the bin, so only edges that leave their bin are looked at.
void includeErrorsOfRow(const BracketedRow& here, const BracketedRow& next_y,
                        const BracketedRow& next_z, std::int64_t count, const IsovalueBins& bins,
                        const ErrorTargets& targets);

// The codes (ErrorCode) of the greatest errors in cells of `step` voxels, 2 to 8, both ends
// included: of (error + slack) * units_per_error, or 0 where there is none. `errors` are those of
// `count` voxels, of which runs were touched; they are 0 again afterwards. codes[cell] becomes the
// greater of what it is and the new one.
void takeCodes(float* errors, RunBits touched, std::int64_t count, std::int64_t step, float slack,
               float units_per_error, std::uint8_t* codes);

// to[i] becomes the greatest of itself and from[i] of all rows of `count` codes, from_stride apart.
void includeGreater(const std::uint8_t* from, std::int64_t from_stride, std::int64_t rows,
                    std::int64_t count, std::uint8_t* to);

// least[i] and greatest[i] take in values[i].
void includeRange(const float* values, std::int64_t count, float* least, float* greatest);

}  // namespace isobrick
