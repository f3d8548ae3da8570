// Cells of level 1 whose error may be beyond a tolerance, a brick at a time (rule 15).
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "isobrick/extract/kernels/error_flags.h"
#include "isobrick/extract/meshing/active_tiles.h"
#include "isobrick/extract/oracles/cell_bits.h"
#include "isobrick/extract/session/mesh_context.h"

namespace isobrick {

// What a brick of level 0 says of cells of level 1: boxes without cells where it says nothing.
struct FoundCells {
  // Of the brick's cells and of a ring around them: those that may be beyond the tolerance.
  CellBits may_be_beyond;
  // Of the brick's: those of them that are where all that touches them is of level 0.
  CellBits are_beyond;
};

// The cells of level 1 in a brick of level 0.
inline IndexBox coarseCellsOf(const BrickLayout& layout, const Index3& brick) {
  return parentsOf(layout.brickCellBox(0, brick));
}

// Finds the cells; keeps its memory from brick to brick. One object serves one thread.
//
// A leaf of level 1 has at each corner the sample of level 1, or that of level 0 where a leaf of
// level 0 touches it; a leaf of level 0 has at corners that hang on the former the mean of the two
// or four ends. Which of them it is depends on what is refined around. So the field of the coarse
// leaf is taken to lie anywhere between the interpolants of the lesser and of the greater of the
// two samples, and a cell may be beyond the tolerance if for any field there
//
//   - a crossing on an edge of level 0 in the closed cell lies where level 0 is beyond it,
//   - or a voxel in the closed cell that is beyond it comes to the wrong side,
//   - or a crossing on an edge of level 0 that leads away from the cell, with the end that the cell
//     has hanging on it and the other end its own voxel, lies where level 0 is beyond it. (Where
//     the other end hangs too, it hangs on a leaf that has the whole edge.)
//
// It is beyond, whatever is refined elsewhere, if that is so of samples of level 0 at all corners:
// then it is refined, and those that touch it have such corners (ErrorOracle).
class ErrorCells {
 public:
  // By the edges and voxels of the brick's closed box: what a ring cell has from other bricks is
  // missing. A brick without an active tile says nothing; its samples are not asked for.
  //
  // Only cells for which wants(cell of level 2 around it) holds, and holds for all cells of level 2
  // that touch the cell, are asked for: of others something may be missing.
  FoundCells find(const MeshContext& context, const Index3& brick, const ErrorBound& bound,
                  const std::function<bool(const Index3&)>& wants);

 private:
  // Voxels of a row, both ends included.
  struct VoxelRun {
    std::int64_t first, last;

    std::int64_t count() const { return last - first + 1; }
  };

  ActiveTiles tiles_;
  // Of all rows that the same tiles touch, and where those of each begin.
  std::vector<VoxelRun> runs_;
  std::vector<std::size_t> first_runs_;
  std::vector<std::uint8_t> active_row_;
  // Of two planes of voxels in turn: values and bounds, row by row.
  std::vector<float> planes_[2];
  std::vector<std::uint8_t> is_filled_[2];
  std::vector<std::uint8_t> flags_;
  std::vector<std::uint8_t> cells_;  // of the box with the ring, x fastest; 1: beyond
  template <typename T>
  class Brick;
};

}  // namespace isobrick
