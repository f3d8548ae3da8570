// What a cell is to a given level: part of a coarser leaf, a leaf, or refined.
#pragma once

#include <cstdint>
#include <vector>

#include "isobrick/extract/oracles/curvature_oracle.h"
#include "isobrick/extract/oracles/focus_oracle.h"

namespace isobrick {

// Bits, so that the states of several cells can be joined.
enum class CellState : std::uint8_t { kOutside = 1, kCoarser = 2, kLeaf = 4, kFiner = 8 };

// Joins the oracles: a cell is refined where all of them refine it. One object serves one thread
// for one brick.
class LeafClassifier {
 public:
  explicit LeafClassifier(const MeshContext& context)
      : lattice_(context.lattice()), focus_(context.focus), curvature_(context) {}

  // States of all cells of a box of `level` (x fastest), which may reach beyond the volume by one.
  // `out` is resized.
  void classify(int level, const IndexBox& cells, std::vector<CellState>& out);

  // False where the oracles rule out that a cell of the box is a leaf of `level`.
  bool mayHoldLeaf(int level, const IndexBox& cells) const;
  // False where they rule out that a cell of the box is refined.
  bool mayRefine(int level, const IndexBox& cells) const;
  // True where every cell in the box and every cell that touches it is a leaf of `level`. False
  // where that is not certain.
  bool areAllLeaves(int level, const IndexBox& cells) const;

 private:
  bool refines(int level, const Index3& cell) {
    return focus_.refines(level, cell) && curvature_.refines(level, cell);
  }
  Share shareOfRefined(int level, const IndexBox& cells) const {
    const Share share = focus_.shareOfRefined(level, cells);
    return share == Share::kNone ? share
                                 : coarserShare(share, curvature_.shareOfRefined(level, cells));
  }

  const Lattice& lattice_;
  const FocusOracle& focus_;
  CurvatureOracle curvature_;
  std::vector<std::uint8_t> parent_is_refined_;  // of the box at hand
};

}  // namespace isobrick
