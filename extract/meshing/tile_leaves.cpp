#include "isobrick/extract/meshing/tile_leaves.h"

#include <algorithm>

namespace isobrick {

bool findLeaves(LeafClassifier& classifier, int level, const IndexBox& cells, TileLeaves& out) {
  if (!classifier.mayHoldLeaf(level, cells)) return false;
  out.level = level;
  out.cells = cells;
  out.all_leaves = classifier.areAllLeaves(level, cells);
  if (out.all_leaves) return true;
  classifier.classify(level, {cells.first - Index3(1), cells.count + Index3(2)}, out.states);
  return std::find(out.states.begin(), out.states.end(), CellState::kLeaf) != out.states.end();
}

}  // namespace isobrick
