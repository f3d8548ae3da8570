// Rows of bits that say which corners of the transition zone's cells are inside (rule 6).
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <vector>

#include "isobrick/extract/kernels/brick_rows.h"
#include "isobrick/extract/kernels/row_bits.h"
#include "isobrick/extract/meshing/brick_split.h"
#include "isobrick/extract/meshing/corner_values.h"

namespace isobrick {

// Rows of corners of one brick. Most corners have their own sample's bit, compared already; those
// that touch a finer leaf, or hang on a coarser one between corners of both kinds, are resolved one
// by one. Keeps its memory.
class TransitionCorners {
 public:
  // Marks in `rows` the rows to compare for the zone.
  void reset(const Lattice& lattice, const BrickSplit& split, const IndexBox& cells,
             BrickRows& rows) {
    level_ = split.leaves().level();
    cells_ = cells;
    last_ = lattice.samples(split.leaves().level()) - Index3(1);
    words_ = wordsOf(cells.count.x + 1);
    slice_ = rows.rowsPerSlice();
    const auto count = static_cast<std::size_t>((cells.count.y + 1) * (cells.count.z + 1));
    found_.assign(count, 0);
    touching_.resize(2 * count * static_cast<std::size_t>(words_));
    for (auto* row : {&inside_, &finer_here_, &hanging_, &all_, &any_})
      row->resize(static_cast<std::size_t>(words_));
    // A corner hangs between ends in rows of even indices, which are the brick's too.
    std::uint8_t* const compare_too = rows.compare_too.data();
    for (const BrickSplit::ZoneRow& row : split.zoneRows()) {
      const std::int64_t j = row.j / 2 * 2, last_j = std::min(j + 2, cells.count.y);
      const std::int64_t k = row.k / 2 * 2, last_k = std::min(k + 2, cells.count.z);
      for (const std::int64_t z : {k, k + 1, last_k})
        for (const std::int64_t y : {j, j + 1, last_j}) compare_too[rows.row(y, z)] = 1;
    }
  }

  // Gives the corners of the zone's cells in `rows`, which are compared, their bits.
  template <typename T>
  void resolve(const Lattice& lattice, float isovalue, const BrickSplit& split,
               BrickFamily<T>& family, BrickRows& rows) {
    for (const BrickSplit::ZoneRow& row : split.zoneRows())
      for (const std::int64_t k : {row.k, row.k + 1})
        for (const std::int64_t j : {row.j, row.j + 1}) {
          const auto r = static_cast<std::size_t>(rows.row(j, k));
          if (found_[r] != 0) continue;
          found_[r] = 1;
          std::uint64_t* const finer = touching_.data() + 2 * words_ * rows.row(j, k);
          std::uint64_t* const coarser = finer + words_;
          split.leaves().cornersTouching(j, k, finer, coarser);
          if ((cells_.first.y + j) % 2 == 0 && (cells_.first.z + k) % 2 == 0)
            for (std::int64_t word = 0; word < words_; ++word) coarser[word] &= kOdd;
          resolveRow(lattice, isovalue, split, j, k, family, rows);
        }
  }

  // After resolve(): whether a finer, and a coarser, leaf touches a corner of a cell of the zone,
  // counted from the brick's first. A corner that is one of the coarser leaf too, all of its
  // indices being even, counts as not touched: it has its own sample's value either way.
  struct Touching {
    bool finer, coarser;
  };
  Touching touching(const Index3& corner) const {
    const std::uint64_t* row = touching_.data() + 2 * words_ * (corner.z * slice_ + corner.y);
    const std::int64_t word = corner.x / 64;
    return {(row[word] >> corner.x % 64 & 1) != 0, (row[words_ + word] >> corner.x % 64 & 1) != 0};
  }

  // After resolve(): the edges along `axis` from row r of corners, of which a leaf of another level
  // touches an end, in that sense. In the words of BrickRows::crossed, and at corner 0. (An edge
  // that a coarser leaf touches has an end of odd index that it touches.)
  class RowEdges {
   public:
    bool hasAny() const { return low_ != nullptr || high_ != nullptr; }
    bool atFirst() const { return (touched(0) & 1) != 0; }
    std::uint64_t word(std::int64_t n) const {
      const std::uint64_t here = touched(n), next = n + 1 < words_ ? touched(n + 1) : 0;
      const std::uint64_t behind = here >> 1 | next << 63;
      return high_ == low_ ? here | behind : behind;
    }

   private:
    friend class TransitionCorners;
    std::uint64_t touched(std::int64_t n) const {
      std::uint64_t any = 0;
      if (low_ != nullptr) any = low_[n] | low_[words_ + n];
      if (high_ != nullptr) any |= high_[n] | high_[words_ + n];
      return any;
    }
    // Of the rows that have the edges' ends, if they touch the zone: the same for axis 0.
    const std::uint64_t *low_, *high_;
    std::int64_t words_;
  };
  RowEdges edges(int axis, std::int64_t r) const {
    RowEdges of;
    of.words_ = words_;
    of.low_ = foundRow(r);
    of.high_ = axis == 0 ? of.low_ : foundRow(r + (axis == 1 ? 1 : slice_));
    return of;
  }

 private:
  using Words = std::vector<std::uint64_t>;

  // Null if row r of corners touches no cell of the zone.
  const std::uint64_t* foundRow(std::int64_t r) const {
    if (static_cast<std::size_t>(r) >= found_.size() || found_[static_cast<std::size_t>(r)] == 0)
      return nullptr;
    return touching_.data() + 2 * words_ * r;
  }

  // Corner `i` of the brick along y or z, twice, or if it is not on the coarser lattice the two
  // between which it hangs.
  std::array<std::int64_t, 2> endsOf(int axis, std::int64_t i) const {
    const std::int64_t step = i % 2 == 0 || cells_.first[axis] + i == last_[axis] ? 0 : 1;
    return {i - step, i + step};
  }
  void takeOwn(const BrickRows& rows, std::int64_t r, std::uint64_t* out) const {
    const std::uint64_t* own = rows.inside.data() + r * rows.words_per_row;
    std::uint64_t carry = rows.first_inside[static_cast<std::size_t>(r)];
    for (std::int64_t word = 0; word < words_; ++word) {
      const std::uint64_t bits = word < rows.words_per_row ? own[word] : 0;
      out[word] = bits << 1 | carry;
      carry = bits >> 63;
    }
  }
  // Corners of which all, and any, ends are inside: those between which they hang, or themselves.
  void joinEnds(const BrickRows& rows, std::int64_t j, std::int64_t k) {
    const auto [y, next_y] = endsOf(1, j);
    const auto [z, next_z] = endsOf(2, k);
    const std::int64_t ends[4] = {rows.row(y, z), rows.row(next_y, z), rows.row(y, next_z),
                                  rows.row(next_y, next_z)};
    std::uint64_t all_carry = 1, any_carry = 0;
    for (const std::int64_t r : ends) {
      all_carry &= rows.first_inside[static_cast<std::size_t>(r)];
      any_carry |= rows.first_inside[static_cast<std::size_t>(r)];
    }
    for (std::int64_t word = 0; word < words_; ++word) {
      std::uint64_t all = 0, any = 0;
      if (word < rows.words_per_row) {
        const std::uint64_t* own = rows.inside.data() + word;
        const std::uint64_t a = own[ends[0] * rows.words_per_row],
                            b = own[ends[1] * rows.words_per_row],
                            c = own[ends[2] * rows.words_per_row],
                            d = own[ends[3] * rows.words_per_row];
        all = a & b & c & d;
        any = a | b | c | d;
      }
      all_[static_cast<std::size_t>(word)] = all << 1 | all_carry;
      any_[static_cast<std::size_t>(word)] = any << 1 | any_carry;
      all_carry = all >> 63;
      any_carry = any >> 63;
    }
    // Along x even corners stay as they are, and so does the last.
    const std::int64_t last = last_.x - cells_.first.x;
    std::uint64_t all_before = 0, any_before = 0;
    for (std::size_t word = 0; word < all_.size(); ++word) {
      const std::uint64_t all = all_[word], any = any_[word];
      const bool has_next = word + 1 < all_.size();
      const std::uint64_t all_sides =
          (all << 1 | all_before) & (all >> 1 | (has_next ? all_[word + 1] << 63 : 0));
      const std::uint64_t any_sides =
          (any << 1 | any_before) | (any >> 1 | (has_next ? any_[word + 1] << 63 : 0));
      const std::uint64_t odd =
          kOdd & ~bitsBetween(last, last + 1, static_cast<std::int64_t>(word));
      all_before = all >> 63;
      any_before = any >> 63;
      all_[word] = (all & ~odd) | (all_sides & odd);
      any_[word] = (any & ~odd) | (any_sides & odd);
    }
  }
  // The other way round.
  void putOwn(const std::uint64_t* in, std::int64_t r, BrickRows& rows) const {
    std::uint64_t* own = rows.inside.data() + r * rows.words_per_row;
    rows.first_inside[static_cast<std::size_t>(r)] = static_cast<std::uint8_t>(in[0] & 1);
    for (std::int64_t word = 0; word < rows.words_per_row; ++word)
      own[word] = in[word] >> 1 | (word + 1 < words_ ? in[word + 1] << 63 : 0);
  }
  template <typename T>
  void resolveRow(const Lattice& lattice, float isovalue, const BrickSplit& split, std::int64_t j,
                  std::int64_t k, BrickFamily<T>& family, BrickRows& rows) {
    const int level = split.leaves().level();
    const std::int64_t r = rows.row(j, k);
    const std::uint64_t* const touches_finer = touching_.data() + 2 * words_ * r;
    const std::uint64_t* const touches_coarser = touches_finer + words_;
    std::uint64_t carry = 0, any_hanging = 0, any_finer = 0;
    for (std::int64_t word = 0; word < words_; ++word) {
      const std::uint64_t cells = zoneCells(split, j, k, word);
      const std::uint64_t corners = cells | cells << 1 | carry;
      carry = cells >> 63;
      finer_here_[static_cast<std::size_t>(word)] = touches_finer[word] & corners;
      hanging_[static_cast<std::size_t>(word)] =
          touches_coarser[word] & ~touches_finer[word] & corners;
      any_hanging |= hanging_[static_cast<std::size_t>(word)];
      any_finer |= finer_here_[static_cast<std::size_t>(word)];
    }
    if ((any_hanging | any_finer) == 0) return;
    if (any_hanging != 0) joinEnds(rows, j, k);
    takeOwn(rows, r, inside_.data());
    const Index3 first = cells_.first + Index3(0, j, k);
    for (std::int64_t word = 0; word < words_; ++word) {
      const auto w = static_cast<std::size_t>(word);
      // A corner that hangs between corners of one kind is of that kind.
      const std::uint64_t hanging = hanging_[w];
      inside_[w] = (inside_[w] & ~hanging) | (all_[w] & hanging);
      std::uint64_t others = hanging & (all_[w] ^ any_[w]);
      for (; others != 0; others &= others - 1) {
        const int bit = std::countr_zero(others);
        const Index3 sample = first + Index3(64 * word + bit, 0, 0);
        putBit(w, bit, ownValueOnCoarserLeaf(lattice, level, sample, family.own()) >= isovalue);
      }
    }
    if (any_finer != 0) resolveFiner(lattice, isovalue, level, first, family);
    putOwn(inside_.data(), r, rows);
  }
  // The corners of the row that a finer leaf touches: they have that leaf's samples.
  template <typename T>
  void resolveFiner(const Lattice& lattice, float isovalue, int level, const Index3& first,
                    BrickFamily<T>& family) {
    const SampleView<T>* view = nullptr;
    std::int64_t row = 0;      // the offset of its sample 0 along x
    std::int64_t end = 0;      // where another brick begins
    std::int64_t own_end = 0;  // up to here own bits stay
    Index3 fine = finerSample(lattice, level, first);
    const std::int64_t last_x = lattice.samples(level - 1).x - 1;
    for (std::size_t w = 0; w < finer_here_.size(); ++w)
      for (std::uint64_t rest = finer_here_[w]; rest != 0; rest &= rest - 1) {
        const int bit = std::countr_zero(rest);
        fine.x = std::min(2 * (first.x + 64 * static_cast<std::int64_t>(w) + bit), last_x);
        if (fine.x < own_end) continue;
        if (view == nullptr || fine.x >= end) {
          view = nullptr;
          own_end = family.endOfOwnSide(fine);
          if (fine.x < own_end) continue;
          view = &family.finer(fine);
          row = view->offset(fine) - fine.x;
          end = family.endOfFiner(fine);
        }
        putBit(w, bit, static_cast<float>(*view->at(row + fine.x)) >= isovalue);
      }
  }
  void putBit(std::size_t word, int bit, bool is_inside) {
    const std::uint64_t mask = std::uint64_t{1} << bit;
    inside_[word] = (inside_[word] & ~mask) | (is_inside ? mask : 0);
  }
  // The zone's cells beside row (j, k) of corners.
  std::uint64_t zoneCells(const BrickSplit& split, std::int64_t j, std::int64_t k,
                          std::int64_t word) const {
    if (word >= wordsOf(cells_.count.x)) return 0;
    return split.zone(j, k)[word] | split.zone(j - 1, k)[word] | split.zone(j, k - 1)[word] |
           split.zone(j - 1, k - 1)[word];
  }

  static constexpr std::uint64_t kOdd = 0xAAAAAAAAAAAAAAAAull;

  int level_ = 0;
  IndexBox cells_;
  std::int64_t words_ = 0;           // of a row of corners, corner i in bit i % 64 of word i / 64
  std::int64_t slice_ = 0;           // rows
  std::vector<std::uint8_t> found_;  // rows beside the zone
  // Of rows that were found: the corners that a finer leaf touches, then those that a coarser does.
  Words touching_;
  Index3 last_{0};                                   // sample of the level
  Words inside_, finer_here_, hanging_, all_, any_;  // of the current row
};

}  // namespace isobrick
