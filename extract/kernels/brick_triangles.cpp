#define HWY_WANT_AVX3_DL
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "isobrick/extract/kernels/brick_triangles.cpp"
#include "isobrick/extract/kernels/brick_triangles.h"

#include <hwy/foreach_target.h>  // must come before highway.h
#include <hwy/highway.h>

#include <bit>

#include "isobrick/extract/kernels/brick_rows.h"
#include "isobrick/extract/kernels/marching_cubes_table.h"

#ifndef ISOBRICK_EXTRACT_PACKED_CASE
#define ISOBRICK_EXTRACT_PACKED_CASE
namespace isobrick {

// A pattern's triangles. A cell's twelve edges lie in eight rows: along x those of its four rows of
// corners, along y and z those of two rows each, in which it has an edge at its low and at its high
// side. Row `n` gives slot 2n, the number of the first crossing at or beyond the cell's high side,
// and slot 2n + 1, that number less one: the crossing at the low side, if there is one. For the
// rows along x slot 2n is the cell's own edge.
struct PackedCase {
  std::uint8_t slots[15] = {};
  std::uint8_t indices = 0;  // three a triangle
};

constexpr std::uint8_t slotOfEdge(int edge) {
  const int axis = edge / 4, u = edge & 1, v = edge >> 1 & 1;
  if (axis == 0) return static_cast<std::uint8_t>(2 * (u + 2 * v));
  return static_cast<std::uint8_t>(2 * (2 + 2 * axis + v) + (u == 0 ? 1 : 0));
}

}  // namespace isobrick
#endif

HWY_BEFORE_NAMESPACE();
namespace isobrick {
namespace HWY_NAMESPACE {
// The numbers that one row of cells needs from the rows around it.
struct CellRow {
  std::uint32_t number[8];        // of the first crossing of each of the eight rows, see PackedCase
  std::uint32_t first_number[4];  // those of rows 4 .. 7 at corner 0
};

// Crossing words in the order of PackedCase.
HWY_INLINE void crossedWords(const BrickRows& rows, std::int64_t r, std::int64_t word,
                             std::uint64_t (&out)[8]) {
  const std::int64_t words = rows.words_per_row, slice = rows.rowsPerSlice();
  const std::uint64_t* x = rows.crossed[0].data() + r * words + word;
  const std::uint64_t* y = rows.crossed[1].data() + r * words + word;
  const std::uint64_t* z = rows.crossed[2].data() + r * words + word;
  out[0] = x[0];
  out[1] = x[words];
  out[2] = x[slice * words];
  out[3] = x[(slice + 1) * words];
  out[4] = y[0];
  out[5] = y[slice * words];
  out[6] = z[0];
  out[7] = z[words];
}

// The crossed cells `cells` of one word. Writes up to 16 elements at a time; `end` is where all
// triangles of the brick end.
HWY_INLINE std::uint32_t* meshWord(const CellWords& c, const std::uint64_t (&crossed)[8],
                                   std::uint64_t cells, const CellRow& row, const PackedCase* cases,
                                   std::uint32_t* out, const std::uint32_t* end) {
#if HWY_TARGET == HWY_AVX3_DL
  const auto set8 = [](const std::uint64_t(&w)[8]) {
    return _mm512_set_epi64(static_cast<long long>(w[7]), static_cast<long long>(w[6]),
                            static_cast<long long>(w[5]), static_cast<long long>(w[4]),
                            static_cast<long long>(w[3]), static_cast<long long>(w[2]),
                            static_cast<long long>(w[1]), static_cast<long long>(w[0]));
  };
  const __m512i corners = set8(c.corners);
  const __m512i crossings = set8(crossed);
  const __m512i numbers =
      _mm512_cvtepu32_epi64(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(row.number)));
  // Low halves: the number; high halves: less one.
  const __m512i bases = _mm512_or_si512(
      numbers, _mm512_slli_epi64(_mm512_add_epi32(numbers, _mm512_set1_epi64(0xFFFFFFFFll)), 32));
  for (; cells != 0; cells &= cells - 1) {
    const std::uint64_t bit = cells & (~cells + 1);
    const __m512i bits = _mm512_set1_epi64(static_cast<long long>(bit));
    const __m512i below = _mm512_set1_epi64(static_cast<long long>(bit - 1));
    const unsigned pattern = _cvtmask8_u32(_mm512_test_epi64_mask(corners, bits));
    const __m512i count = _mm512_popcnt_epi64(_mm512_and_si512(crossings, below));
    const __m512i slots =
        _mm512_add_epi32(bases, _mm512_or_si512(count, _mm512_slli_epi64(count, 32)));
    const __m512i order = _mm512_cvtepu8_epi32(
        _mm_loadu_si128(reinterpret_cast<const __m128i*>(cases[pattern].slots)));
    const __m512i made = _mm512_permutexvar_epi32(order, slots);
    const std::uint32_t indices = cases[pattern].indices;
    if (HWY_LIKELY(out + 16 <= end)) {
      _mm512_storeu_si512(out, made);
    } else {
      _mm512_mask_storeu_epi32(out, static_cast<__mmask16>((1u << indices) - 1), made);
    }
    out += indices;
  }
#else
  for (; cells != 0; cells &= cells - 1) {
    const int cell = std::countr_zero(cells);
    const std::uint64_t below = (std::uint64_t{1} << cell) - 1;
    std::uint32_t slots[16];
    for (std::size_t n = 0; n < 8; ++n) {
      slots[2 * n] = row.number[n] + static_cast<std::uint32_t>(std::popcount(crossed[n] & below));
      slots[2 * n + 1] = slots[2 * n] - 1;
    }
    const PackedCase& packed = cases[c.pattern(cell)];
    if (HWY_LIKELY(out + 15 <= end)) {
      for (std::size_t i = 0; i < 15; ++i) out[i] = slots[packed.slots[i]];
    } else {
      for (std::size_t i = 0; i < packed.indices; ++i) out[i] = slots[packed.slots[i]];
    }
    out += packed.indices;
  }
#endif
  return out;
}

// Cell 0 of a row if the brick's low side x is another's.
HWY_INLINE std::uint32_t* meshFirstCell(const CellWords& c, const CellRow& row,
                                        const PackedCase* cases, std::uint32_t* out) {
  std::uint32_t slots[16];
  for (std::size_t n = 0; n < 8; ++n) {
    slots[2 * n] = row.number[n];
    slots[2 * n + 1] = n < 4 ? 0 : row.first_number[n - 4];
  }
  const PackedCase& packed = cases[c.pattern(0)];
  for (std::size_t i = 0; i < packed.indices; ++i) *out++ = slots[packed.slots[i]];
  return out;
}

void makeAllTriangles(const BrickRows& rows, const FirstVertices& first, const PackedCase* cases,
                      std::uint32_t* out) {
  const std::int64_t words = rows.words_per_row;
  const auto slice = static_cast<std::size_t>(rows.rowsPerSlice());
  const std::uint32_t* const end = out + 3 * static_cast<std::size_t>(rows.triangles);
  const bool foreign_first = (rows.foreign_sides & 1) != 0;
  for (const std::size_t r : rows.rows_with_crossed_cells.list()) {
    const std::size_t r10 = r + 1, r01 = r + slice, r11 = r01 + 1;
    CellRow row = {{first[0] + rows.numbers[0][r], first[0] + rows.numbers[0][r10],
                    first[0] + rows.numbers[0][r01], first[0] + rows.numbers[0][r11],
                    first[1] + rows.numbers[1][r], first[1] + rows.numbers[1][r01],
                    first[2] + rows.numbers[2][r], first[2] + rows.numbers[2][r10]},
                   {}};
    for (std::int64_t w = 0; w < words; ++w) {
      const auto row_number = static_cast<std::int64_t>(r);
      const CellWords c(rows, row_number, w);
      std::uint64_t crossed[8];
      crossedWords(rows, row_number, w, crossed);
      std::uint64_t cells =
          rows.crossed_cells[r * static_cast<std::size_t>(words) + static_cast<std::size_t>(w)];
      if (foreign_first && w == 0 && (cells & 1) != 0) {
        row.first_number[0] = first[1] + rows.first_numbers[0][r];
        row.first_number[1] = first[1] + rows.first_numbers[0][r01];
        row.first_number[2] = first[2] + rows.first_numbers[1][r];
        row.first_number[3] = first[2] + rows.first_numbers[1][r10];
        out = meshFirstCell(c, row, cases, out);
        cells &= cells - 1;
      }
      if (cells != 0) out = meshWord(c, crossed, cells, row, cases, out, end);
      if (words > 1)
        for (std::size_t n = 0; n < 8; ++n)
          row.number[n] += static_cast<std::uint32_t>(std::popcount(crossed[n]));
    }
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace isobrick
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace isobrick {
namespace {

using PackedCases = std::array<PackedCase, 256>;

PackedCases packCases(bool mirrored) {
  PackedCases cases;
  for (std::size_t pattern = 0; pattern < 256; ++pattern) {
    const MarchingCubesCase& from = marchingCubesTable()[pattern];
    PackedCase& to = cases[pattern];
    to.indices = static_cast<std::uint8_t>(3 * from.triangle_count);
    for (std::size_t i = 0; i < to.indices; ++i) {
      // The second and the third corner of a triangle change places.
      const std::size_t source = !mirrored || i % 3 == 0 ? i : i % 3 == 1 ? i + 1 : i - 1;
      to.slots[i] = slotOfEdge(from.edges[source]);
    }
  }
  return cases;
}

}  // namespace

HWY_EXPORT(makeAllTriangles);

void makeTriangles(const BrickRows& rows, const FirstVertices& first, bool mirrored,
                   std::uint32_t* triangles) {
  static const PackedCases cases[2] = {packCases(false), packCases(true)};
  HWY_DYNAMIC_DISPATCH(makeAllTriangles)(rows, first, cases[mirrored ? 1 : 0].data(), triangles);
}

}  // namespace isobrick
#endif
