#include "isobrick/extract/meshing/leaf_rows.h"

#include <algorithm>
#include <functional>

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
  cells_of_row_.assign(static_cast<std::size_t>(words_), 0);
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
  // Cell -1 is bit 0; if the volume begins with the brick, there is none.
  const int shift = begin_ == cells_.first.x ? 1 : 0;
  std::uint64_t refined[kMostWords] = {};
  const std::uint64_t* exists = classifier_->classifyRow(level_, {begin_, y, z}, count_, refined);
  std::uint64_t *finer = leaf + kFiner * words_, *coarser = leaf + kCoarser * words_;
  std::uint64_t exists_carry = 0, refined_carry = 0;
  const std::int64_t found = wordsOf(count_);
  for (std::int64_t word = 0; word < words_; ++word) {
    const std::uint64_t exists_here = word < found ? exists[word] : 0;
    const std::uint64_t refined_here = refined[word];
    const std::uint64_t existing = exists_here << shift | exists_carry;
    finer[word] = refined_here << shift | refined_carry;
    leaf[word] = existing & ~finer[word];
    coarser[word] = cells_of_row_[static_cast<std::size_t>(word)] & ~existing;
    exists_carry = shift == 0 ? 0 : exists_here >> 63;
    refined_carry = shift == 0 ? 0 : refined_here >> 63;
  }
  std::uint64_t* const beside = leaf + kBesideOthers * words_;
  std::uint64_t here = finer[0] | coarser[0];
  for (std::int64_t word = 0; word < words_; ++word) {
    const std::uint64_t next = word + 1 < words_ ? finer[word + 1] | coarser[word + 1] : 0;
    beside[word] = here | (here >> 1 | next << 63) | (here >> 2 | next << 62);
    here = next;
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

void LeafRows::findAround(std::int64_t j, std::int64_t k) {
  const std::uint8_t* const found = &found_[index(j - 1, k - 1)];
  const std::int64_t slice = cells_.count.y + 2;
  std::uint8_t all = 1;
  for (const std::uint8_t* of : {found, found + slice, found + 2 * slice})
    all &= of[0] & of[1] & of[2];
  if (all != 0) return;
  for (std::int64_t dk = -1; dk <= 1; ++dk)
    for (std::int64_t dj = -1; dj <= 1; ++dj) find(j + dj, k + dk);
}

void LeafRows::leaves(std::int64_t j, std::int64_t k, std::uint64_t* out) const {
  const std::uint64_t* leaf = words(kLeaf, j, k);
  for (std::int64_t word = 0; word < wordsOf(cells_.count.x); ++word)
    out[word] = leaf[word] >> 1 | leaf[word + 1] << 63;
}

void LeafRows::leavesAmongLeaves(std::int64_t j, std::int64_t k, std::uint64_t* out) const {
  const std::uint64_t* leaf = words(kLeaf, j, k);
  const std::int64_t next_row = kKinds * words_, next_slice = next_row * (cells_.count.y + 2);
  const std::uint64_t* beside = words(kBesideOthers, j - 1, k - 1);
  for (std::int64_t word = 0; word < wordsOf(cells_.count.x); ++word, ++beside) {
    std::uint64_t touched = 0;
    for (const std::uint64_t* slice : {beside, beside + next_slice, beside + 2 * next_slice})
      touched |= slice[0] | slice[next_row] | slice[2 * next_row];
    out[word] = (leaf[word] >> 1 | leaf[word + 1] << 63) & ~touched;
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

LeafRows::EdgeBits LeafRows::edgesAround(int axis, std::int64_t j, std::int64_t k,
                                         std::int64_t word) const {
  const std::int64_t beside_j = axis == 1 ? j : j - 1, beside_k = axis == 1 ? k - 1 : k;
  const auto rowsOf = [&](Kind kind, std::int64_t n, auto join) {
    std::uint64_t bits = join(words(kind, j, k)[n], words(kind, beside_j, beside_k)[n]);
    if (axis == 0) bits = join(bits, join(words(kind, j, k - 1)[n], words(kind, j - 1, k - 1)[n]));
    return bits;
  };
  // Cell i is bit i + 1.
  const auto edgesOf = [&](Kind kind, auto join) {
    const std::uint64_t here = rowsOf(kind, word, join), next = rowsOf(kind, word + 1, join);
    const std::uint64_t cells = here >> 1 | next << 63;
    return axis == 0 ? cells : join(cells, here >> 2 | next << 62);
  };
  return {edgesOf(kLeaf, std::bit_and<std::uint64_t>()),
          edgesOf(kCoarser, std::bit_or<std::uint64_t>())};
}

LeafRows::EdgeBits LeafRows::firstEdgeAround(int axis, std::int64_t j, std::int64_t k) const {
  const std::int64_t beside_j = axis == 1 ? j : j - 1, beside_k = axis == 1 ? k - 1 : k;
  const std::uint64_t leaves = words(kLeaf, j, k)[0] & words(kLeaf, beside_j, beside_k)[0];
  const std::uint64_t coarser = words(kCoarser, j, k)[0] | words(kCoarser, beside_j, beside_k)[0];
  return {leaves & leaves >> 1 & 1, (coarser | coarser >> 1) & 1};
}

}  // namespace isobrick
