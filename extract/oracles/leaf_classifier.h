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

  // The cell's state; it may lie beyond the volume.
  CellState state(int level, const Index3& cell);
  // Of the `count` cells of `level` from `first` on along x, which the volume has, bit i being
  // first.x + i: those whose parent is refined, and of these the ones that are refined themselves.
  // Both get whole words, with zeros behind the last cell.
  void classifyRow(int level, const Index3& first, std::int64_t count, std::uint64_t* exists,
                   std::uint64_t* refined);

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
  void keepRefined(int level, const Index3& first, std::int64_t count, std::uint64_t* bits) {
    focus_.keepRefined(level, first, count, bits);
    curvature_.keepRefined(level, first, count, bits);
  }
  Share shareOfRefined(int level, const IndexBox& cells) const {
    const Share share = focus_.shareOfRefined(level, cells);
    return share == Share::kNone ? share
                                 : coarserShare(share, curvature_.shareOfRefined(level, cells));
  }

  const Lattice& lattice_;
  const FocusOracle& focus_;
  CurvatureOracle curvature_;
  // Refined parents of the row asked for last.
  std::vector<std::uint64_t> parents_;
  int parents_level_ = -1;
  Index3 parents_first_{0};
  std::int64_t parents_count_ = 0;
};

}  // namespace isobrick
