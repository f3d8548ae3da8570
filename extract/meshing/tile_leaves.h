// Which cells of a tile are leaves, and what touches them.
#pragma once

#include <vector>

#include "isobrick/extract/oracles/leaf_classifier.h"

namespace isobrick {

struct TileLeaves {
  int level = 0;
  IndexBox cells;  // of the tile, in the level
  // Every cell of the tile and every one that touches it is a leaf; `states` is not filled then.
  bool all_leaves = false;
  std::vector<CellState> states;  // of the cells and of all that touch them, x fastest

  // `cell`: of the tile, or touching it.
  CellState state(const Index3& cell) const {
    if (all_leaves) return CellState::kLeaf;  // beyond the volume too, which changes nothing
    return states[static_cast<std::size_t>(
        linearIndex(cell - cells.first + Index3(1), cells.count + Index3(2)))];
  }
};

// Fills `out` and keeps its memory. False where the tile has no leaf of `level`.
bool findLeaves(LeafClassifier& classifier, int level, const IndexBox& cells, TileLeaves& out);

}  // namespace isobrick
