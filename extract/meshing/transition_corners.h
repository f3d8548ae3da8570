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
    for (auto* rows_of : {&finer_, &coarser_})
      rows_of->resize(count * static_cast<std::size_t>(words_));
    for (auto* row : {&inside_, &finer_here_, &hanging_, &all_, &any_})
      row->resize(static_cast<std::size_t>(words_));
    for (const int axis : {1, 2}) {
      ends_[axis - 1].resize(static_cast<std::size_t>(cells.count[axis]) + 1);
      for (std::int64_t i = 0; i <= cells.count[axis]; ++i) {
        const auto [low, high] = endsAround(lattice, level_, axis, cells.first[axis] + i);
        ends_[axis - 1][static_cast<std::size_t>(i)] = {low - cells.first[axis],
                                                        high - cells.first[axis]};
      }
    }
    std::uint8_t* const compare_too = rows.compare_too.data();
    for (const BrickSplit::ZoneRow& row : split.zoneRows())
      for (const std::int64_t k : {row.k, row.k + 1})
        for (const std::int64_t j : {row.j, row.j + 1}) {
          compare_too[rows.row(j, k)] = 1;
          for (const std::int64_t z : endsOf(2, k))
            for (const std::int64_t y : endsOf(1, j)) compare_too[rows.row(y, z)] = 1;
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
          split.leaves().cornersTouching(j, k, wordsAt(finer_, r), wordsAt(coarser_, r));
          if ((cells_.first.y + j) % 2 == 0 && (cells_.first.z + k) % 2 == 0)
            for (std::int64_t word = 0; word < words_; ++word) wordsAt(coarser_, r)[word] &= kOdd;
          resolveRow(lattice, isovalue, split, j, k, family, rows);
        }
  }

  // After resolve(): whether a finer, and a coarser, leaf touches a corner of a cell of the zone,
  // counted from the brick's first. A corner that is one of the coarser leaf too, all of its
  // indices being even, counts as not touched: it has its own sample's value either way.
  bool touchesFiner(const Index3& corner) const { return isSet(finer_, corner); }
  bool touchesCoarser(const Index3& corner) const { return isSet(coarser_, corner); }

  // After resolve(): edges along `axis` from row r of corners, of which a leaf of another level
  // touches an end, in that sense. In the words of BrickRows::crossed, and at corner 0. (An edge
  // that a coarser leaf touches has an end of odd index that it touches.)
  bool hasEdges(int axis, std::int64_t r) const { return isFound(r) || isFound(r + stepOf(axis)); }
  bool hasFirstEdge(int axis, std::int64_t r) const {
    return ((touched(r, 0) | touched(r + stepOf(axis), 0)) & 1) != 0;
  }
  std::uint64_t edges(int axis, std::int64_t r, std::int64_t word) const {
    if (axis == 0) {
      const std::uint64_t here = touched(r, word);
      return here | here >> 1 | touched(r, word + 1) << 63;
    }
    const std::int64_t to = r + stepOf(axis);
    return (touched(r, word) | touched(to, word)) >> 1 |
           (touched(r, word + 1) | touched(to, word + 1)) << 63;
  }

 private:
  using Words = std::vector<std::uint64_t>;

  std::uint64_t* wordsAt(Words& rows, std::size_t r) {
    return rows.data() + r * static_cast<std::size_t>(words_);
  }
  bool isSet(const Words& rows, const Index3& corner) const {
    const std::int64_t r = corner.z * slice_ + corner.y;
    return (rows[static_cast<std::size_t>(r * words_ + corner.x / 64)] >> corner.x % 64 & 1) != 0;
  }
  std::int64_t stepOf(int axis) const { return axis == 0 ? 0 : axis == 1 ? 1 : slice_; }
  bool isFound(std::int64_t r) const {
    return static_cast<std::size_t>(r) < found_.size() && found_[static_cast<std::size_t>(r)] != 0;
  }
  std::uint64_t touched(std::int64_t r, std::int64_t word) const {
    if (word >= words_ || !isFound(r)) return 0;
    const auto at = static_cast<std::size_t>(r * words_ + word);
    return finer_[at] | coarser_[at];
  }

  // endsAround() of corner `i` of the brick along y or z.
  const std::array<std::int64_t, 2>& endsOf(int axis, std::int64_t i) const {
    return ends_[axis - 1][static_cast<std::size_t>(i)];
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
    const std::uint64_t* touches_finer = wordsAt(finer_, static_cast<std::size_t>(r));
    const std::uint64_t* touches_coarser = wordsAt(coarser_, static_cast<std::size_t>(r));
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
  Words finer_, coarser_;            // of rows that were found: corners that such a leaf touches
  Index3 last_{0};                   // sample of the level
  std::vector<std::array<std::int64_t, 2>> ends_[2];
  Words inside_, finer_here_, hanging_, all_, any_;  // of the current row
};

}  // namespace isobrick
