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
  words_ = wordsOf(cells.count.x + 2);
  const auto rows = static_cast<std::size_t>((cells.count.y + 2) * (cells.count.z + 2));
  found_.assign(rows, 0);
  bits_.resize(rows * kKinds * static_cast<std::size_t>(words_) + 1);
  begin_ = std::max<std::int64_t>(cells.first.x - 1, 0);
  count_ = std::min(cells.end().x + 1, level_cells_.x) - begin_;
  shift_ = begin_ == cells.first.x ? 1 : 0;
  cells_of_row_.resize(static_cast<std::size_t>(words_));
  for (std::int64_t word = 0; word < words_; ++word)
    cells_of_row_[static_cast<std::size_t>(word)] = bitsBetween(shift_, shift_ + count_, word);
}

void LeafRows::classify(std::int64_t j, std::int64_t k) {
  if (!isInVolume(j, k)) {
    std::uint64_t* const row = rowAt(j, k);
    std::fill(row, row + kKinds * words_, 0);
    found_[index(j, k)] = 1;
  } else if (classifier_->hasRuns()) {
    classifyByRuns(j, k);
  } else {
    classifyByCell(j, k);
  }
}

void LeafRows::classifyByCell(std::int64_t j, std::int64_t k) {
  std::uint64_t refined[kMostWords] = {};
  const std::uint64_t* exists = classifier_->classifyRow(
      level_, {begin_, cells_.first.y + j, cells_.first.z + k}, count_, refined);
  const std::int64_t found = wordsOf(count_);
  std::uint64_t exists_carry = 0, refined_carry = 0;
  const auto shifted = [&](std::uint64_t word, std::uint64_t& carry) {
    const std::uint64_t before = carry;
    carry = shift_ == 0 ? 0 : word >> 63;
    return word << shift_ | before;
  };
  putRow(
      j, k,
      [&](std::int64_t word) { return shifted(word < found ? exists[word] : 0, exists_carry); },
      [&](std::int64_t word) { return shifted(refined[word], refined_carry); });
}

// Eight rows at once cost little more than one.
void LeafRows::classifyByRuns(std::int64_t j, std::int64_t k) {
  constexpr auto kRows = static_cast<std::int64_t>(SphereRows::kMost);
  const std::int64_t first = (j + 1) / kRows * kRows - 1;
  const std::int64_t begin = std::max(first, -cells_.first.y);
  const std::int64_t end =
      std::min({first + kRows, cells_.count.y + 1, level_cells_.y - cells_.first.y});
  CellSpan existing[kRows], refined[kRows];
  classifier_->classifyRows(level_, {begin_, cells_.first.y + begin, cells_.first.z + k}, count_,
                            static_cast<std::size_t>(end - begin), existing, refined);
  for (std::int64_t row = 0; row < end - begin; ++row) {
    const auto bitsOf = [this](const CellSpan& run) {
      return [from = run.begin + shift_, to = run.end + shift_](std::int64_t word) {
        return bitsBetween(from, to, word);
      };
    };
    putRow(begin + row, k, bitsOf(existing[row]), bitsOf(refined[row]));
  }
}

template <typename Existing, typename Refined>
void LeafRows::putRow(std::int64_t j, std::int64_t k, Existing&& existing, Refined&& refined) {
  found_[index(j, k)] = 1;
  std::uint64_t* const finer = rowAt(j, k);
  for (std::int64_t word = 0; word < words_; ++word) {
    const std::uint64_t exists = existing(word);
    finer[word] = refined(word) & exists;
    finer[words_ + word] = cells_of_row_[static_cast<std::size_t>(word)] & ~exists;
  }
}

void LeafRows::findAround(std::int64_t j, std::int64_t k) {
  for (std::int64_t dk = -1; dk <= 1; ++dk)
    for (std::int64_t dj = -1; dj <= 1; ++dj) find(j + dj, k + dk);
}

void LeafRows::leaves(std::int64_t j, std::int64_t k, std::uint64_t* out) const {
  for (std::int64_t word = 0; word < wordsOf(cells_.count.x); ++word)
    out[word] = leafWord(j, k, word) >> 1 | leafWord(j, k, word + 1) << 63;
}

void LeafRows::besideOthers(std::int64_t j, std::int64_t k, std::uint64_t* out) const {
  const std::int64_t next_row = kKinds * words_, next_slice = next_row * (cells_.count.y + 2);
  const std::uint64_t* row = words(kFiner, j - 1, k - 1);
  // Cells that are finer or coarser in any of the nine rows.
  const auto othersOf = [&](std::int64_t word) {
    std::uint64_t others = 0;
    if (word < words_)
      for (const std::uint64_t* slice : {row, row + next_slice, row + 2 * next_slice})
        for (const std::uint64_t* of : {slice, slice + next_row, slice + 2 * next_row})
          others |= of[word] | of[words_ + word];
    return others;
  };
  std::uint64_t here = othersOf(0);
  for (std::int64_t word = 0; word < wordsOf(cells_.count.x); ++word) {
    const std::uint64_t next = othersOf(word + 1);
    out[word] = here | (here >> 1 | next << 63) | (here >> 2 | next << 62);
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

LeafRows::EdgeBits LeafRows::edgesAround(int axis, std::int64_t j, std::int64_t k,
                                         std::int64_t word) const {
  const std::int64_t beside_j = axis == 1 ? j : j - 1, beside_k = axis == 1 ? k - 1 : k;
  const auto find = [&](Kind kind) {
    const std::uint64_t* a = words(kind, j, k) + word;
    const std::uint64_t* b = words(kind, beside_j, beside_k) + word;
    std::uint64_t here = a[0] | b[0], next = a[1] | b[1];
    if (axis == 0) {
      const std::uint64_t* c = words(kind, j, k - 1) + word;
      const std::uint64_t* d = words(kind, j - 1, k - 1) + word;
      here |= c[0] | d[0];
      next |= c[1] | d[1];
    }
    // Cell i is bit i + 1.
    const std::uint64_t cells = here >> 1 | next << 63;
    return axis == 0 ? cells : cells | here >> 2 | next << 62;
  };
  return {find(kFiner), find(kCoarser)};
}

LeafRows::EdgeBits LeafRows::firstEdgeAround(int axis, std::int64_t j, std::int64_t k) const {
  const std::int64_t beside_j = axis == 1 ? j : j - 1, beside_k = axis == 1 ? k - 1 : k;
  const auto find = [&](Kind kind) {
    const std::uint64_t cells = words(kind, j, k)[0] | words(kind, beside_j, beside_k)[0];
    return (cells | cells >> 1) & 1;
  };
  return {find(kFiner), find(kCoarser)};
}

}  // namespace isobrick
