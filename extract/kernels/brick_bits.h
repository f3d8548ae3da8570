// Words of bits of a brick's rows (see brick_rows.h), and the corner bits of a row of cells.
#pragma once

#include "isobrick/extract/kernels/brick_rows.h"
#include "isobrick/extract/kernels/row_bits.h"

namespace isobrick {

// The cells of word `word` in a row of `cells`.
inline std::uint64_t cellBits(std::int64_t cells, std::int64_t word) {
  return lowBits(cells - 64 * word);
}

// Crossed edges along x: bit i is the edge of cell i. `carry` is the corner before the word's
// first.
inline std::uint64_t crossedAlongX(std::uint64_t word, std::uint64_t carry, std::uint64_t cells) {
  return (word ^ (word << 1 | carry)) & cells;
}

// The bits that 64 cells in a row have at their corners; bit i is the cell's.
struct CellWords {
  std::uint64_t corners[8];  // corner x + 2y + 4z

  CellWords(const BrickRows& rows, std::int64_t r, std::int64_t word) {
    const std::int64_t up[4] = {0, 1, rows.cells.y + 1, rows.cells.y + 2};
    for (int n = 0; n < 4; ++n) {
      const std::int64_t at = (r + up[n]) * rows.words_per_row + word;
      const std::uint64_t high = rows.inside[static_cast<std::size_t>(at)];
      const std::uint64_t carry =
          word == 0 ? std::uint64_t{rows.first_inside[static_cast<std::size_t>(r + up[n])]}
                    : rows.inside[static_cast<std::size_t>(at - 1)] >> 63;
      corners[2 * n] = high << 1 | carry;
      corners[2 * n + 1] = high;
    }
  }

  // Cells with corners of both kinds.
  std::uint64_t crossedCells(std::uint64_t cells) const {
    const std::uint64_t any = (corners[0] | corners[1] | corners[2] | corners[3]) |
                              (corners[4] | corners[5] | corners[6] | corners[7]);
    const std::uint64_t all = (corners[0] & corners[1] & corners[2] & corners[3]) &
                              (corners[4] & corners[5] & corners[6] & corners[7]);
    return any & ~all & cells;
  }
  // Cells with corners of both kinds on face `face` (cell_topology.h).
  std::uint64_t crossed(int face) const {
    const int axis = face / 2, first = face % 2 << axis;
    const int u = 1 << (axis + 1) % 3, v = 1 << (axis + 2) % 3;
    const std::uint64_t a = corners[first], b = corners[first + u], c = corners[first + v],
                        d = corners[first + u + v];
    return (a | b | c | d) & ~(a & b & c & d);
  }
  unsigned pattern(int cell) const {
    unsigned bits = 0;
    for (unsigned c = 0; c < 8; ++c) bits |= static_cast<unsigned>(corners[c] >> cell & 1) << c;
    return bits;
  }
};

}  // namespace isobrick
