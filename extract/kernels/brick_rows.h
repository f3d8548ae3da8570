// A brick as rows of bits: samples that are inside, edges that are crossed, numbers of crossings.
//
// The route through a brick that is all leaves of one level:
//
//   samples -> compareRows -> bits of the corner rows -> numberRows -> numbers and counts
//           -> makeCrossings (brick_crossings.h)      -> positions and normals
//           -> makeTriangles (brick_triangles.h)      -> triangles
//
// Corner (i, j, k) of the brick is the low corner of its cell (i, j, k). A corner row is all i for
// one (j, k); its bits for i >= 1 lie in words of 64, corner i in bit (i - 1) % 64 of word
// (i - 1) / 64, so that the 65 corners of 64 cells need one word, and corner 0 a byte of its own.
//
// Numbers: first all crossings on edges along x, then along y, then along z; within an axis by k,
// j, i of the edge's lower end. So the number of a crossing is that of its row and the bits below
// its own, and no table of edges is kept.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "isobrick/extract/kernels/row_bits.h"
#include "isobrick/storage/grid.h"

namespace isobrick {

// Greatest number of cells of a brick along an axis (docs/FORMAT.md).
inline constexpr std::int64_t kMaxBrickCells = 256;

// The samples of one brick. T: the voxel type.
template <typename T>
struct BrickGrid {
  const T* data = nullptr;  // x fastest
  Index3 stored{0};         // samples along each axis
  Index3 inset{0};          // of corner (0,0,0): 0 or 1
  Index3 cells{0};          // 1 .. kMaxBrickCells

  const T* row(std::int64_t j, std::int64_t k) const {
    return data + ((k + inset.z) * stored.y + j + inset.y) * stored.x + inset.x;
  }
};

// Some rows of a brick, ascending; the memory stays from brick to brick.
struct RowList {
  std::vector<std::uint32_t> rows;  // more than `count`, so that lanes may write beyond
  std::size_t count = 0;

  std::span<const std::uint32_t> list() const { return {rows.data(), count}; }
};

// Kept from brick to brick. Rows have the index r = k * (cells.y + 1) + j.
struct BrickRows {
  // Low sides of the brick whose crossings are another brick's: bit `axis`.
  unsigned foreign_sides = 0;

  Index3 cells{0};
  std::int64_t words_per_row = 1;
  // Number of the first crossing of row r beyond corner 0, counted within the axis. If the row is
  // another brick's, that brick's number. Only of rows with crossings.
  std::array<std::vector<std::uint32_t>, 3> numbers;  // [axis][r]
  // Number of the crossing at corner 0, for the foreign side x: [axis - 1][r].
  std::array<std::vector<std::uint32_t>, 2> first_numbers;

  // Further rows of corners to compare, [r]: 1 if TransitionCorners needs their bits.
  std::vector<std::uint8_t> compare_too;
  // By compareRows(): [r * words_per_row + word] and [r]; of rows that touch a wanted cell.
  std::vector<std::uint64_t> inside;
  std::vector<std::uint8_t> first_inside;  // corner 0

  // By numberRows(): the crossed edges of wanted cells, other bricks' too. Bit i is the edge of
  // cell i for axis 0, and that of corner i + 1 for the others.
  std::array<std::vector<std::uint64_t>, 3> crossed;       // [axis][r * words_per_row + word]
  std::array<std::vector<std::uint8_t>, 2> crossed_first;  // [axis - 1][r]: at corner 0
  std::array<RowList, 3> crossed_rows;                     // [axis]
  // Wanted cells with corners of both kinds: [r * words_per_row + word] of the rows listed.
  std::vector<std::uint64_t> crossed_cells;
  RowList rows_with_crossed_cells;
  std::array<std::uint32_t, 3> crossings{};  // own crossings along each axis
  std::uint32_t triangles = 0;
  std::uint32_t crossed_cell_count = 0;

  std::int64_t row(std::int64_t j, std::int64_t k) const { return k * (cells.y + 1) + j; }
  std::int64_t rowsPerSlice() const { return cells.y + 1; }
  std::uint32_t ownCrossings() const { return crossings[0] + crossings[1] + crossings[2]; }
  // True if the crossings along `axis` of row (j, k) beyond corner 0 are another brick's.
  bool isForeign(int axis, std::int64_t j, std::int64_t k) const {
    return (axis != 1 && j == 0 && (foreign_sides & 2) != 0) ||
           (axis != 2 && k == 0 && (foreign_sides & 4) != 0);
  }

  // The number of the first crossing of row r beyond corner 0 among all the brick's own, which come
  // axis by axis. That at corner 0 is one less.
  std::uint32_t rowNumber(int axis, std::int64_t r) const {
    std::uint32_t number = numbers[static_cast<std::size_t>(axis)][static_cast<std::size_t>(r)];
    for (int before = 0; before < axis; ++before)
      number += crossings[static_cast<std::size_t>(before)];
    return number;
  }

  // Sizes everything for a brick, of which no cell is wanted yet.
  void resize(const Index3& brick_cells);
  // The cells of row (j, k), j < cells.y and k < cells.z, that are to be meshed: words_per_row
  // words, cell i in bit i % 64. Every cell with a crossing of which any corner's other cells are
  // wanted must be wanted itself, or the mesh is open there.
  std::uint64_t* wantedCells(std::int64_t j, std::int64_t k) { return wanted(row(j, k)); }
  const std::uint64_t* wanted(std::int64_t r) const {
    return wanted_.data() + (r + before_) * words_per_row;
  }
  std::uint64_t* wanted(std::int64_t r) { return wanted_.data() + (r + before_) * words_per_row; }

 private:
  // With empty rows around, so that every row has all its neighbours.
  std::vector<std::uint64_t> wanted_;
  std::int64_t before_ = 0;
};

// Compares the corner rows that wanted cells have. T: the voxel type.
template <typename T>
void compareRows(const BrickGrid<T>& grid, T threshold, BrickRows& rows);

// From bits to numbers and counts; leaves the numbers of foreign rows alone.
void numberRows(BrickRows& rows);

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
  // Cells with corners of both kinds on face `face` (contour.h).
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
