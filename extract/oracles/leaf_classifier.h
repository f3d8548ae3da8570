// The kind of a cell at a given level: part of a coarser leaf, a leaf, or refined.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "isobrick/extract/oracles/curvature_oracle.h"
#include "isobrick/extract/oracles/query_oracles.h"

namespace isobrick {

// Bits, so that the states of several cells can be joined.
enum class CellState : std::uint8_t { kOutside = 1, kCoarser = 2, kLeaf = 4, kFiner = 8 };

// Joins the oracles: a cell is refined if any choice of the query refines it, and a choice refines
// it if all of its oracles do. In a progressive query the resident parts have to allow it too. One
// object serves one thread for one brick.
class LeafClassifier {
 public:
  // Without reads it is less certain of boxes of cells.
  explicit LeafClassifier(const MeshContext& context, BrickReads reads = BrickReads::kNone);

  // The cell's state; it may lie beyond the volume.
  CellState state(int level, const Index3& cell);
  // Classifies the `count` cells of `level` from `first` on along x, which the volume has; bit i is
  // cell first.x + i. Returns those whose parent is refined, valid until the next call, and puts
  // the ones of these that are refined themselves into `refined`. Both are whole words, with zeros
  // behind the last cell.
  const std::uint64_t* classifyRow(int level, const Index3& first, std::int64_t count,
                                   std::uint64_t* refined);

  // True if in every row the cells that exist, and those that are refined, are one run each, which
  // classifyRows() finds: the focus alone decides.
  bool hasRuns() const { return has_runs_; }
  // The runs of classifyRow() in `rows` rows at once, at most SphereRows::kMost, that follow each
  // other along y. They may be empty, and a row's refined cells may seem to reach beyond its
  // existing ones, by rounding.
  void classifyRows(int level, const Index3& first, std::int64_t count, std::size_t rows,
                    CellSpan* existing, CellSpan* refined) const;

  // False if the oracles rule out that a cell of the box is a leaf of `level`.
  bool mayHoldLeaf(int level, const IndexBox& cells) const;
  // False if they rule out that a cell of the box is refined.
  bool mayRefine(int level, const IndexBox& cells) const;
  // True if every cell in the box and every cell that touches it is a leaf of `level`. False if
  // that is not certain.
  bool areAllLeaves(int level, const IndexBox& cells) const;

 private:
  struct Choice {
    const ChoiceOracles& shared;
    CurvatureOracle curvature;

    bool refines(int level, const Index3& cell);
    void keepRefined(int level, const Index3& first, std::int64_t count, std::uint64_t* bits);
    // The same for the oracles that need no brick.
    void keepPlaced(int level, const Index3& first, std::int64_t count, std::uint64_t* bits) const;
    Coverage refinedCoverage(int level, const IndexBox& cells) const;
  };

  bool refines(int level, const Index3& cell);
  void keepRefined(int level, const Index3& first, std::int64_t count, std::uint64_t* bits);
  void keepResident(int level, const Index3& first, std::int64_t count, std::uint64_t* bits);
  Coverage refinedCoverage(int level, const IndexBox& cells) const;
  const std::uint64_t* existingRow(int level, const Index3& first, std::int64_t count);

  const Lattice& lattice_;
  ResidencyOracle* const residency_;  // null: every needed part is read
  std::vector<Choice> choices_;
  bool has_runs_ = false;
  std::vector<std::uint64_t> asked_, kept_;  // of a row, if there are several choices
  // Rows of cells of which the parents are refined, as four rows have the same parents: the latest
  // ones, as many as the rows of a tile and around it have along y and z.
  struct ParentRow {
    int level = -1;
    Index3 first{0};
  };
  static constexpr std::int64_t kParentRows = 4;
  std::array<ParentRow, kParentRows * kParentRows> parent_rows_;
  std::vector<std::uint64_t> parents_;     // refined ones, of the current row
  std::vector<std::uint64_t> exists_;      // row by row of parent_rows_
  std::int64_t first_x_ = 0, count_ = -1;  // of every row's cells
};

}  // namespace isobrick
