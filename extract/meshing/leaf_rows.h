// Which cells of a brick are leaves, and which leaves of other levels touch them.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "isobrick/extract/kernels/brick_rows.h"
#include "isobrick/extract/oracles/leaf_classifier.h"

namespace isobrick {

// The states of a brick's cells and of all that touch them, as rows of bits. A row is found when it
// is first needed. One object serves one thread, brick after brick, and keeps its memory.
class LeafRows {
 public:
  // `cells`: of the brick, in the lattice's `level`. The classifier must outlive all later calls.
  void reset(LeafClassifier& classifier, const Lattice& lattice, int level, const IndexBox& cells);

  int level() const { return level_; }

  // Finds row (j, k), counted from the brick's first cell; -1 and the count itself are the rows
  // that touch it. The functions below take only cells in rows that were found.
  void find(std::int64_t j, std::int64_t k) {
    std::uint8_t& found = found_[index(j, k)];
    if (found == 0) {
      found = 1;
      classify(j, k);
    }
  }
  // The same for the row and all that touch it.
  void findAround(std::int64_t j, std::int64_t k);
  // The row's leaves, cell i in bit i % 64 of word i / 64; `out` holds a word for every 64 cells.
  // Here and below bits behind the brick's last cell are of other bricks' cells.
  void leaves(std::int64_t j, std::int64_t k, std::uint64_t* out) const;
  // The row's leaves that only leaves touch. Rows beyond the volume touch nothing. All rows around
  // must have been found.
  void leavesAmongLeaves(std::int64_t j, std::int64_t k, std::uint64_t* out) const;

  // Which corners of corner row (j, k) a finer and a coarser leaf touch: corner i in bit i % 64 of
  // word i / 64, the brick's cells along x and one. All rows around must have been found.
  void cornersTouching(std::int64_t j, std::int64_t k, std::uint64_t* finer,
                       std::uint64_t* coarser) const;
  // Which cells of word `word` of the row have a refined cell across face f: bit i of [f] is cell
  // 64 word + i, as in leaves(). Rows beside it must have been found.
  std::array<std::uint64_t, 6> besideFiner(std::int64_t j, std::int64_t k, std::int64_t word) const;
  // Edges along `axis` from corner row (j, k): those that only leaves touch, and those that a
  // coarser leaf touches. Cells beyond the volume are neither. Bit i of word `word` is corner 64
  // word + i for axis 0 and the one behind it for the others, as in BrickRows::crossed.
  struct EdgeBits {
    std::uint64_t among_leaves = 0, beside_coarser = 0;
  };
  EdgeBits edgesAround(int axis, std::int64_t j, std::int64_t k, std::int64_t word) const;
  // The same for corner 0 alone, in bit 0. Not of axis 0.
  EdgeBits firstEdgeAround(int axis, std::int64_t j, std::int64_t k) const;
  // Whether a cell of the level is refined: one of the brick's, or one that touches it.
  bool isRefined(const Index3& cell) const {
    const Index3 at = cell - cells_.first;
    return (twoAt(kFiner, at.x, at.y, at.z) & 1) != 0;
  }

 private:
  // Bit i + 1 of a row's words is cell i. In kBesideOthers bit i says that the cell, or one beside
  // it in the row, is finer or coarser.
  static constexpr std::size_t kMostWords = (kMaxBrickCells + 2 + 63) / 64 + 1;
  enum Kind { kLeaf, kFiner, kCoarser, kBesideOthers, kKinds };

  std::size_t index(std::int64_t j, std::int64_t k) const {
    return static_cast<std::size_t>((k + 1) * (cells_.count.y + 2) + j + 1);
  }
  const std::uint64_t* words(Kind kind, std::int64_t j, std::int64_t k) const {
    return bits_.data() + (index(j, k) * kKinds + kind) * static_cast<std::size_t>(words_);
  }
  void classify(std::int64_t j, std::int64_t k);
  static void shiftByOne(std::vector<std::uint64_t>& row);
  // Bits 0 and 1: cells i and i + 1 of row (j, k) are of the kind.
  unsigned twoAt(Kind kind, std::int64_t i, std::int64_t j, std::int64_t k) const {
    const std::int64_t bit = i + 1;
    const std::uint64_t* from = words(kind, j, k) + bit / 64;
    std::uint64_t bits = from[0] >> bit % 64;
    if (bit % 64 == 63) bits |= from[1] << 1;
    return static_cast<unsigned>(bits & 3);
  }

  LeafClassifier* classifier_ = nullptr;
  Index3 level_cells_{0};
  int level_ = 0;
  IndexBox cells_;
  std::int64_t words_ = 0;  // of a row of one kind
  std::vector<std::uint8_t> found_;
  std::vector<std::uint64_t> bits_;
  // The cells of every row that the classifier classifies.
  std::int64_t begin_ = 0, count_ = 0;  // along x, counted in the level
  std::vector<std::uint64_t> cells_of_row_;
};

}  // namespace isobrick
