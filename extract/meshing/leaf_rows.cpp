#include "isobrick/extract/meshing/leaf_rows.h"

#include <algorithm>

#include "isobrick/extract/kernels/row_bits.h"

namespace isobrick {

void LeafRows::reset(LeafClassifier& classifier, const Lattice& lattice, int level,
                     const IndexBox& cells) {
  classifier_ = &classifier;
  level_cells_ = lattice.cells(level);
  level_ = level;
  cells_ = cells;
  words_ = wordsOf(cells.count.x + 2) + 1;  // and one of zeros, so that every word has a next
  const auto rows = static_cast<std::size_t>((cells.count.y + 2) * (cells.count.z + 2));
  found_.assign(rows, 0);
  bits_.resize(rows * kKinds * static_cast<std::size_t>(words_));
  begin_ = std::max<std::int64_t>(cells.first.x - 1, 0);
  count_ = std::min(cells.end().x + 1, level_cells_.x) - begin_;
  for (auto* row : {&exists_, &refined_, &cells_of_row_})
    row->assign(static_cast<std::size_t>(words_), 0);
  setBits(cells_of_row_.data(), count_);
  if (begin_ == cells.first.x) shiftByOne(cells_of_row_);
}

void LeafRows::classify(std::int64_t j, std::int64_t k) {
  std::uint64_t* leaf = bits_.data() + index(j, k) * kKinds * static_cast<std::size_t>(words_);
  const std::int64_t y = cells_.first.y + j, z = cells_.first.z + k;
  if (y < 0 || z < 0 || y >= level_cells_.y || z >= level_cells_.z) {
    std::fill(leaf, leaf + kKinds * words_, 0);
    return;
  }
  classifier_->classifyRow(level_, {begin_, y, z}, count_, exists_.data(), refined_.data());
  // Cell -1 is bit 0; where the volume begins with the brick, there is none.
  if (begin_ == cells_.first.x)
    for (auto* row : {&exists_, &refined_}) {
      std::fill(row->begin() + wordsOf(count_), row->end(), 0);  // a bit of the row before
      shiftByOne(*row);
    }
  std::uint64_t *finer = leaf + kFiner * words_, *coarser = leaf + kCoarser * words_;
  for (std::int64_t word = 0; word < words_; ++word) {
    const auto w = static_cast<std::size_t>(word);
    const std::uint64_t exists = exists_[w], refined = refined_[w];
    leaf[word] = exists & ~refined;
    finer[word] = refined;
    coarser[word] = cells_of_row_[w] & ~exists;
  }
}

// Bit i becomes bit i + 1.
void LeafRows::shiftByOne(std::vector<std::uint64_t>& row) {
  std::uint64_t carry = 0;
  for (std::uint64_t& word : row) {
    const std::uint64_t last = word >> 63;
    word = word << 1 | carry;
    carry = last;
  }
}

void LeafRows::leaves(std::int64_t j, std::int64_t k, std::uint64_t* out) const {
  const std::uint64_t* leaf = words(kLeaf, j, k);
  for (std::int64_t word = 0; word < wordsOf(cells_.count.x); ++word)
    out[word] = leaf[word] >> 1 | leaf[word + 1] << 63;
}

void LeafRows::leavesAmongLeaves(std::int64_t j, std::int64_t k, std::uint64_t* out) const {
  const std::uint64_t* leaf = words(kLeaf, j, k);
  const auto others = [&](std::int64_t word) {
    std::uint64_t any = 0;
    for (std::int64_t dk = -1; dk <= 1; ++dk)
      for (std::int64_t dj = -1; dj <= 1; ++dj)
        any |= words(kFiner, j + dj, k + dk)[word] | words(kCoarser, j + dj, k + dk)[word];
    return any;
  };
  std::uint64_t here = others(0);
  for (std::int64_t word = 0; word < wordsOf(cells_.count.x); ++word) {
    const std::uint64_t next = others(word + 1);
    // Cell i lies between bits i, i + 1 and i + 2.
    const std::uint64_t touched = here | (here >> 1 | next << 63) | (here >> 2 | next << 62);
    out[word] = (leaf[word] >> 1 | leaf[word + 1] << 63) & ~touched;
    here = next;
  }
}

std::array<std::uint64_t, 6> LeafRows::besideFiner(std::int64_t j, std::int64_t k,
                                                   std::int64_t word) const {
  // Cell i is bit i + 1, and lies between bits i and i + 2.
  const auto across = [&](std::int64_t to_j, std::int64_t to_k) {
    const std::uint64_t* finer = words(kFiner, to_j, to_k) + word;
    return finer[0] >> 1 | finer[1] << 63;
  };
  const std::uint64_t* own = words(kFiner, j, k) + word;
  return {own[0],           own[0] >> 2 | own[1] << 62, across(j - 1, k),
          across(j + 1, k), across(j, k - 1),           across(j, k + 1)};
}

void LeafRows::cornersTouching(std::int64_t j, std::int64_t k, std::uint64_t* finer,
                               std::uint64_t* coarser) const {
  // Corner i lies between the cells of bits i and i + 1.
  const auto find = [&](Kind kind, std::uint64_t* out) {
    const std::uint64_t *a = words(kind, j, k), *b = words(kind, j - 1, k),
                        *c = words(kind, j, k - 1), *d = words(kind, j - 1, k - 1);
    for (std::int64_t word = 0; word < wordsOf(cells_.count.x + 1); ++word) {
      const std::uint64_t here = a[word] | b[word] | c[word] | d[word];
      const std::uint64_t next = a[word + 1] | b[word + 1] | c[word + 1] | d[word + 1];
      out[word] = here | here >> 1 | next << 63;
    }
  };
  find(kFiner, finer);
  find(kCoarser, coarser);
}

bool LeafRows::areLeavesAround(const Index3& base, int axis) const {
  const Index3 b = base - cells_.first;
  if (axis == 0)
    return (twoAt(kLeaf, b.x, b.y, b.z) & twoAt(kLeaf, b.x, b.y - 1, b.z) &
            twoAt(kLeaf, b.x, b.y, b.z - 1) & twoAt(kLeaf, b.x, b.y - 1, b.z - 1) & 1) != 0;
  const std::int64_t y = axis == 1 ? b.y : b.y - 1, z = axis == 1 ? b.z - 1 : b.z;
  return (twoAt(kLeaf, b.x - 1, b.y, b.z) & twoAt(kLeaf, b.x - 1, y, z)) == 3;
}

bool LeafRows::isAnyCoarserAround(const Index3& base, int axis) const {
  const Index3 b = base - cells_.first;
  if (axis == 0)
    return ((twoAt(kCoarser, b.x, b.y, b.z) | twoAt(kCoarser, b.x, b.y - 1, b.z) |
             twoAt(kCoarser, b.x, b.y, b.z - 1) | twoAt(kCoarser, b.x, b.y - 1, b.z - 1)) &
            1) != 0;
  const std::int64_t y = axis == 1 ? b.y : b.y - 1, z = axis == 1 ? b.z - 1 : b.z;
  return (twoAt(kCoarser, b.x - 1, b.y, b.z) | twoAt(kCoarser, b.x - 1, y, z)) != 0;
}

}  // namespace isobrick
