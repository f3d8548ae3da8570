// The curvature bound of cells of level 1 (Sect. 5.2 of the paper; rule 4 of the design).
#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace isobrick {

// Least epsilon that fitCurvature takes: below it the sixth power of a gradient leaves single
// precision.
inline constexpr double kLeastCurvatureEpsilon = 0x1p-16;
// Tiles with a narrower range that is not a single value have no bound (code 255).
inline constexpr float kLeastCurvatureRange = 0x1p-120f;

// A row of nodes along x: a node is a cell of level 1, with 3x3x3 voxels that it shares with its
// neighbours. Reused from row to row; all arrays are longer than `nodes` needs, by the elements
// that SIMD reads and writes past the end, and start as 0.
struct CurvatureRow {
  explicit CurvatureRow(std::int64_t node_count);

  std::int64_t nodes;
  // voxels[3 * z + y][2 * i + x] is voxel (x, y, z) of node i. A node with one cell along an axis
  // repeats its last voxels: cells of zero extent, whose samples are those of the border face with
  // part of their derivatives, and can only raise the bound.
  std::array<std::vector<float>, 9> voxels;
  // A range that holds all voxels of the node: the one that its polynomial is over.
  std::vector<float> low, high;
  // Bernstein coefficients b0, b1, b2 over that range, in 1/voxel^2: the result of fitCurvature.
  std::array<std::vector<float>, 3> coefficients;
};

struct CurvatureFitOptions {
  // Samples with a gradient below this part of the node's range per voxel do not count. At least
  // kLeastCurvatureEpsilon.
  double epsilon = 1.0 / 64;
  // The voxels are integers of at most 16 bits: their differences have no rounding to allow for.
  bool small_integers = false;
};

// For every node: coefficients with p(v_i) >= k_i for all samples of its eight cells that count, by
// the update of Sect. 5.2: minimal in the least squares sense, only ever upward. 0 for nodes of one
// value and if no sample counts; infinity if no bound is known (voxels or ranges that are not
// finite, ranges below kLeastCurvatureRange). Runs on the widest SIMD instructions of the machine,
// with the same bits on all of them.
void fitCurvature(const CurvatureFitOptions& options, CurvatureRow& row);

// The coefficients as CurvatureCode::encodeUp codes them, three bytes a node.
void encodeCurvature(const CurvatureRow& row, std::uint8_t* codes);

}  // namespace isobrick
