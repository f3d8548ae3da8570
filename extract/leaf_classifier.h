// What a cell is to a given level: part of a coarser leaf, a leaf, or refined.
#pragma once

#include <cstdint>
#include <unordered_map>
#include <vector>

#include "extract/mesh_context.h"

namespace isobrick {

enum class CellState : std::uint8_t { kOutside, kCoarser, kLeaf, kFiner };

// Joins the focus oracle and the curvature oracle (Sect. 5.2). Keeps the curvature of the bricks
// that it asked for, so one object serves one thread for one brick.
class LeafClassifier {
 public:
  explicit LeafClassifier(const MeshContext& context) : context_(context) {}

  CellState state(int level, const Index3& cell) {
    const Index3 cells = context_.lattice().cells(level);
    for (int axis = 0; axis < 3; ++axis)
      if (cell[axis] < 0 || cell[axis] >= cells[axis]) return CellState::kOutside;
    if (!refines(level + 1, cell / std::int64_t{2})) return CellState::kCoarser;
    return level > 0 && refines(level, cell) ? CellState::kFiner : CellState::kLeaf;
  }

 private:
  struct BrickCurvature {
    std::vector<std::uint8_t> coefficients;
    std::vector<ValueRange> tile_ranges;
  };

  bool refines(int level, const Index3& cell) {
    if (!context_.oracle.refines(level, cell)) return false;
    return !(level == 1 && context_.hasCurvatureOracle() &&
             context_.oracle.curvatureApplies(cell) && isFlat(cell));
  }
  // True where the curvature bound of the cell of level 1 is within the tolerance. Where the
  // isovalue is outside the tile's range, the bound at the range's end decides: cells beside a flat
  // piece of the surface are coarse with it, and no transition is needed between them.
  bool isFlat(const Index3& cell);

  const MeshContext& context_;
  std::unordered_map<std::size_t, BrickCurvature> bricks_;  // by row of the brick table
};

}  // namespace isobrick
