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

  // States of all cells of a box of `level` (x fastest), which may reach beyond the volume by one.
  // `out` is resized.
  void classify(int level, const IndexBox& cells, std::vector<CellState>& out);

  // False where the focus and the tolerance rule out that a cell of the box is a leaf of `level`.
  bool mayHoldLeaf(int level, const IndexBox& cells) const;
  // True where every cell in the box and every cell that touches it is a leaf of `level`, by the
  // focus alone. False where that is not certain.
  bool areAllLeaves(int level, const IndexBox& cells) const;

 private:
  struct BrickCurvature {
    std::vector<std::uint8_t> coefficients;
    std::vector<ValueRange> tile_ranges;
  };

  bool curvatureMayAct(const IndexBox& cells_of_level1) const {
    return context_.hasCurvatureOracle() && context_.oracle.curvatureMayApply(cells_of_level1);
  }
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
  std::vector<std::uint8_t> parent_is_refined_;             // of the box at hand
  std::unordered_map<std::size_t, BrickCurvature> bricks_;  // by row of the brick table
};

}  // namespace isobrick
