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
    if (found_[index(j, k)] == 0) classify(j, k);
  }
  // The same for the row and all that touch it.
  void findAround(std::int64_t j, std::int64_t k);
  // The row's leaves, cell i in bit i % 64 of word i / 64; `out` holds a word for every 64 cells.
  // Here and below bits behind the brick's last cell are of other bricks' cells.
  void leaves(std::int64_t j, std::int64_t k, std::uint64_t* out) const;
  // The row's cells that, or whose neighbours, are finer or coarser: leaves that are not here only
  // leaves touch. Cells beyond the volume are neither. All rows around must have been found.
  void besideOthers(std::int64_t j, std::int64_t k, std::uint64_t* out) const;

  // Which corners of corner row (j, k) a finer and a coarser leaf touch: corner i in bit i % 64 of
  // word i / 64, the brick's cells along x and one. All rows around must have been found.
  void cornersTouching(std::int64_t j, std::int64_t k, std::uint64_t* finer,
                       std::uint64_t* coarser) const;
  // Which cells of word `word` of the row have a refined cell across face f: bit i of [f] is cell
  // 64 word + i, as in leaves(). Rows beside it must have been found.
  std::array<std::uint64_t, 6> besideFiner(std::int64_t j, std::int64_t k, std::int64_t word) const;
  // Edges along `axis` from corner row (j, k) that a finer, and that a coarser leaf touches. Bit i
  // of word `word` is corner 64 word + i for axis 0 and the one behind it for the others, as in
  // BrickRows::crossed.
  struct EdgeBits {
    std::uint64_t beside_finer = 0, beside_coarser = 0;
  };
  EdgeBits edgesAround(int axis, std::int64_t j, std::int64_t k, std::int64_t word) const;
  // The same for corner 0 alone, in bit 0. Not of axis 0.
  EdgeBits firstEdgeAround(int axis, std::int64_t j, std::int64_t k) const;
  // Whether a cell of the level is refined: one of the brick's, or one that touches it.
  bool isRefined(const Index3& cell) const {
    const Index3 at = cell - cells_.first + Index3(1, 0, 0);
    return (words(kFiner, at.y, at.z)[at.x / 64] >> at.x % 64 & 1) != 0;
  }

 private:
  // Bit i + 1 of a row's words is cell i. Cells of the volume that are neither are leaves.
  static constexpr std::size_t kMostWords = (kMaxBrickCells + 2 + 63) / 64;
  enum Kind { kFiner, kCoarser, kKinds };

  std::size_t index(std::int64_t j, std::int64_t k) const {
    return static_cast<std::size_t>((k + 1) * (cells_.count.y + 2) + j + 1);
  }
  // Behind the last word another row's begins: it is read, and shifted behind the last cell.
  const std::uint64_t* words(Kind kind, std::int64_t j, std::int64_t k) const {
    return bits_.data() + (index(j, k) * kKinds + kind) * static_cast<std::size_t>(words_);
  }
  // Of a row of the brick.
  std::uint64_t leafWord(std::int64_t j, std::int64_t k, std::int64_t word) const {
    if (word >= words_) return 0;
    const std::uint64_t* finer = words(kFiner, j, k) + word;
    return cells_of_row_[static_cast<std::size_t>(word)] & ~(finer[0] | finer[words_]);
  }
  // Finds row (j, k), and others beside it if that is cheaper.
  void classify(std::int64_t j, std::int64_t k);
  void classifyByCell(std::int64_t j, std::int64_t k);
  void classifyByRuns(std::int64_t j, std::int64_t k);
  bool isInVolume(std::int64_t j, std::int64_t k) const {
    const std::int64_t y = cells_.first.y + j, z = cells_.first.z + k;
    return y >= 0 && z >= 0 && y < level_cells_.y && z < level_cells_.z;
  }
  std::uint64_t* rowAt(std::int64_t j, std::int64_t k) {
    return bits_.data() + index(j, k) * kKinds * static_cast<std::size_t>(words_);
  }
  // `existing` and `refined`, which may be more: calls with (word) give a word of the row.
  template <typename Existing, typename Refined>
  void putRow(std::int64_t j, std::int64_t k, Existing&& existing, Refined&& refined);

  LeafClassifier* classifier_ = nullptr;
  Index3 level_cells_{0};
  int level_ = 0;
  IndexBox cells_;
  std::int64_t words_ = 0;  // of a row of one kind
  std::vector<std::uint8_t> found_;
  std::vector<std::uint64_t> bits_;
  // The cells of every row that the classifier classifies.
  std::int64_t begin_ = 0, count_ = 0;  // along x, counted in the level
  int shift_ = 0;                       // 1 if there is no cell -1
  std::vector<std::uint64_t> cells_of_row_;
};

}  // namespace isobrick
