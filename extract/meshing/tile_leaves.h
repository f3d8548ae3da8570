// Which cells of a tile are leaves, and what touches them.
#pragma once

#include <array>
#include <vector>

#include "isobrick/extract/oracles/leaf_classifier.h"

namespace isobrick {

// Of which kinds some cells are: the bits of their states.
struct StateSet {
  unsigned bits = 0;

  void add(CellState state) { bits |= static_cast<unsigned>(state); }
  bool has(CellState state) const { return (bits & static_cast<unsigned>(state)) != 0; }
  bool hasOnly(CellState state) const { return bits == static_cast<unsigned>(state); }
};

struct TileLeaves {
  int level = 0;
  IndexBox cells;  // of the tile, in the level
  // Every cell of the tile and every one that touches it is a leaf; `states` is not filled then.
  bool all_leaves = false;
  std::vector<CellState> states;  // of the cells and of all that touch them, x fastest

  // `cell`: of the tile, or touching it.
  CellState state(const Index3& cell) const {
    if (all_leaves) return CellState::kLeaf;  // beyond the volume too, which changes nothing
    return states[indexOf(cell)];
  }
  // The cells that touch a corner of the tile's cells.
  StateSet statesAround(const Index3& corner) const {
    StateSet set;
    const std::size_t row = rowLength(), slice = sliceLength();
    const CellState* at = states.data() + indexOf(corner);
    for (const CellState* cell : {at, at - row, at - slice, at - slice - row}) {
      set.add(cell[0]);
      set.add(cell[-1]);
    }
    return set;
  }
  // The cells that touch the edge along `axis` from corner `base`.
  StateSet statesAround(const Index3& base, int axis) const {
    StateSet set;
    const std::array<std::size_t, 3> steps{1, rowLength(), sliceLength()};
    const std::size_t b = steps[static_cast<std::size_t>((axis + 1) % 3)];
    const std::size_t c = steps[static_cast<std::size_t>((axis + 2) % 3)];
    const CellState* at = states.data() + indexOf(base);
    for (const CellState* cell : {at, at - b, at - c, at - b - c}) set.add(*cell);
    return set;
  }

 private:
  std::size_t rowLength() const { return static_cast<std::size_t>(cells.count.x + 2); }
  std::size_t sliceLength() const {
    return rowLength() * static_cast<std::size_t>(cells.count.y + 2);
  }
  std::size_t indexOf(const Index3& cell) const {
    return static_cast<std::size_t>(
        linearIndex(cell - cells.first + Index3(1), cells.count + Index3(2)));
  }
};

// Fills `out` and keeps its memory. False where the tile has no leaf of `level`.
bool findLeaves(LeafClassifier& classifier, int level, const IndexBox& cells, TileLeaves& out);

}  // namespace isobrick
