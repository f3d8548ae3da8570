#define HWY_WANT_AVX3_DL
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "isobrick/extract/kernels/brick_rows.cpp"
#include "isobrick/extract/kernels/brick_rows.h"

#include <hwy/foreach_target.h>  // must come before highway.h
#include <hwy/highway.h>

#include <bit>
#include <cstring>

#include "isobrick/extract/kernels/marching_cubes_table.h"
#include "isobrick/storage/voxel_type.h"

HWY_BEFORE_NAMESPACE();
namespace isobrick {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Bits of 64 voxels from `row` on.
template <typename T>
HWY_INLINE std::uint64_t insideBits(const T* row, T threshold) {
  const hn::CappedTag<T, 64> d;
  constexpr std::size_t kLanes = hn::MaxLanes(d);
  const auto limit = hn::Set(d, threshold);
  std::uint64_t bits = 0;
  for (std::size_t i = 0; i < 64; i += kLanes) {
    const auto voxels = hn::LoadU(d, row + i);
    // Not every target compares unsigned voxels.
    const auto is_inside = hn::Eq(hn::Max(voxels, limit), voxels);
#if HWY_TARGET == HWY_AVX3 || HWY_TARGET == HWY_AVX3_DL
    bits |= static_cast<std::uint64_t>(is_inside.raw) << i;
#else
    std::uint8_t bytes[8] = {};
    hn::StoreMaskBits(d, is_inside, bytes);
    std::uint64_t some;
    std::memcpy(&some, bytes, 8);
    bits |= some << i;
#endif
  }
  return bits;
}

// Calls f(r) for every row of corners that a wanted cell has, or that compare_too names.
template <typename F>
HWY_INLINE void forEachRowToCompare(const BrickRows& rows, F&& f) {
  const std::int64_t slice = rows.rowsPerSlice(), words = rows.words_per_row;
  const std::int64_t count = slice * (rows.cells.z + 1);
  const std::uint64_t *a = rows.wanted(0), *b = rows.wanted(-1), *c = rows.wanted(-slice),
                      *d = rows.wanted(-slice - 1);
  const auto anyOf = [&](std::int64_t begin, std::int64_t end) {
    std::uint64_t any = 0;
    for (std::int64_t w = begin; w < end; ++w) any |= (a[w] | b[w]) | (c[w] | d[w]);
    return any;
  };
  // Most rows have none: they are passed over eight at a time.
  for (std::int64_t eight = 0; eight < count; eight += 8) {
    std::uint64_t too;
    std::memcpy(&too, rows.compare_too.data() + eight, 8);
    if ((too | anyOf(eight * words, (eight + 8) * words)) == 0) continue;
    for (std::int64_t r = eight; r < std::min(eight + 8, count); ++r)
      if (rows.compare_too[static_cast<std::size_t>(r)] != 0 || anyOf(r * words, (r + 1) * words))
        f(r);
  }
}

template <typename T>
void compareAll(const BrickGrid<T>& grid, T threshold, BrickRows& rows) {
  const std::int64_t nx = rows.cells.x, slice = rows.rowsPerSlice();
  const T* const end = grid.data + elementCount(grid.stored);
  forEachRowToCompare(rows, [&](std::int64_t r) {
    const T* row = grid.row(r % slice, r / slice);
    rows.first_inside[static_cast<std::size_t>(r)] = row[0] >= threshold ? 1 : 0;
    ++row;
    std::uint64_t* words = rows.inside.data() + r * rows.words_per_row;
    for (std::int64_t i = 0; i < nx; i += 64) {
      const std::int64_t count = std::min<std::int64_t>(64, nx - i);
      std::uint64_t bits = 0;
      if (row + i + 64 <= end) {
        bits = insideBits(row + i, threshold);
      } else {
        for (std::int64_t n = 0; n < count; ++n)
          bits |= static_cast<std::uint64_t>(row[i + n] >= threshold ? 1 : 0) << n;
      }
      *words++ = bits & lowBits(count);
    }
  });
}

// Highway dispatches functions, not templates, so this is one for all voxel types: `grid` is a
// BrickGrid<T>, `threshold` a T.
void compareRowsOfType(VoxelType type, const void* grid, const void* threshold, BrickRows& rows) {
  visitVoxelType(type, [&](auto tag) {
    using T = typename decltype(tag)::Type;
    compareAll(*static_cast<const BrickGrid<T>*>(grid), *static_cast<const T*>(threshold), rows);
  });
}

// ---- numbers of crossings: prefix sums of the bits of rows

HWY_INLINE void listRow(std::int64_t r, RowList& list) {
  list.rows[list.count++] = static_cast<std::uint32_t>(r);
}

#if HWY_TARGET == HWY_AVX3_DL
// Triangles of each of 256 patterns, looked up for 64 cells at a time.
struct TriangleCounter {
  __m512i table[4];
  explicit TriangleCounter(const std::uint8_t* counts) {
    for (int i = 0; i < 4; ++i) table[i] = _mm512_loadu_si512(counts + 64 * i);
  }
  std::uint32_t count(const CellWords& c, std::uint64_t cells) const {
    __m512i pattern = _mm512_setzero_si512();
    for (int corner = 0; corner < 8; ++corner)
      pattern = _mm512_mask_add_epi8(pattern, c.corners[corner], pattern,
                                     _mm512_set1_epi8(static_cast<char>(1 << corner)));
    const __m512i low = _mm512_permutex2var_epi8(table[0], pattern, table[1]);
    const __m512i high = _mm512_permutex2var_epi8(table[2], pattern, table[3]);
    const __m512i both = _mm512_maskz_mov_epi8(
        cells, _mm512_mask_blend_epi8(_mm512_movepi8_mask(pattern), low, high));
    return static_cast<std::uint32_t>(
        _mm512_reduce_add_epi64(_mm512_sad_epu8(both, _mm512_setzero_si512())));
  }
};

// Eight rows at a time, one in each lane; for bricks whose rows are one word.
class EightRows {
 public:
  EightRows(BrickRows& rows, const std::uint8_t* triangle_counts)
      : rows_(rows), counter_(triangle_counts) {}

  void run() {
    const std::int64_t ny = rows_.cells.y, nz = rows_.cells.z;
    for (std::int64_t k = 0; k <= nz; ++k)
      for (std::int64_t j = 0; j <= ny; j += 8) {
        const std::int64_t left = ny + 1 - j;
        numberEight(j, k, static_cast<__mmask8>(left >= 8 ? 0xFF : (1 << left) - 1));
      }
    for (std::size_t axis = 0; axis < 3; ++axis)
      rows_.crossings[axis] =
          static_cast<std::uint32_t>(_mm_cvtsi128_si64(_mm512_castsi512_si128(next_[axis])));
    rows_.triangles = triangles_;
    rows_.crossed_cell_count = cell_count_;
  }

 private:
  static __m512i words(const std::uint64_t* from) { return _mm512_loadu_si512(from); }
  static __m512i bytes(const std::uint8_t* from) {
    return _mm512_cvtepu8_epi64(_mm_loadl_epi64(reinterpret_cast<const __m128i*>(from)));
  }

  HWY_INLINE void numberEight(std::int64_t j, std::int64_t k, __mmask8 valid) {
    const std::int64_t r = rows_.row(j, k), slice = rows_.rowsPerSlice();
    const std::uint64_t* wanted = rows_.wanted(r);
    const __m512i m00 = _mm512_maskz_mov_epi64(valid, words(wanted));
    const __m512i m10 = _mm512_maskz_mov_epi64(valid, words(wanted - 1));
    const __m512i m01 = _mm512_maskz_mov_epi64(valid, words(wanted - slice));
    const __m512i m11 = _mm512_maskz_mov_epi64(valid, words(wanted - slice - 1));
    const __m512i near_y = _mm512_or_si512(m00, m01), near_z = _mm512_or_si512(m00, m10);
    const __m512i near_x = _mm512_or_si512(_mm512_or_si512(near_y, m10), m11);
    if (_mm512_test_epi64_mask(near_x, near_x) == 0) return;

    const std::uint64_t* inside = rows_.inside.data() + r;
    const std::uint8_t* first = rows_.first_inside.data() + r;
    const __m512i w0 = words(inside), w1 = words(inside + 1), w2 = words(inside + slice),
                  w3 = words(inside + slice + 1);
    const __m512i f0 = bytes(first), f1 = bytes(first + 1), f2 = bytes(first + slice),
                  f3 = bytes(first + slice + 1);
    const __m512i l0 = lowCorners(w0, f0), l1 = lowCorners(w1, f1), l2 = lowCorners(w2, f2),
                  l3 = lowCorners(w3, f3);

    const __m512i none = _mm512_setzero_si512();
    const auto own = [&](int axis) {
      __mmask8 lanes = valid;
      if (rows_.isForeign(axis, 1, k)) return static_cast<__mmask8>(0);
      if (rows_.isForeign(axis, j, 1)) lanes = static_cast<__mmask8>(lanes & ~1);
      return lanes;
    };
    number(0, r, valid, own(0), _mm512_and_si512(_mm512_xor_si512(w0, l0), near_x), none);
    number(1, r, valid, own(1), _mm512_and_si512(_mm512_xor_si512(w0, w1), cornersOf(near_y)),
           _mm512_and_si512(_mm512_xor_si512(f0, f1), near_y));
    number(2, r, valid, own(2), _mm512_and_si512(_mm512_xor_si512(w0, w2), cornersOf(near_z)),
           _mm512_and_si512(_mm512_xor_si512(f0, f2), near_z));

    const __m512i any =
        _mm512_or_si512(_mm512_or_si512(_mm512_or_si512(w0, w1), _mm512_or_si512(w2, w3)),
                        _mm512_or_si512(_mm512_or_si512(l0, l1), _mm512_or_si512(l2, l3)));
    const __m512i all =
        _mm512_and_si512(_mm512_and_si512(_mm512_and_si512(w0, w1), _mm512_and_si512(w2, w3)),
                         _mm512_and_si512(_mm512_and_si512(l0, l1), _mm512_and_si512(l2, l3)));
    countCells(r, _mm512_and_si512(_mm512_andnot_si512(all, any), m00));
  }

  static __m512i lowCorners(__m512i word, __m512i first) {
    return _mm512_or_si512(_mm512_slli_epi64(word, 1), first);
  }
  // The corners beyond corner 0 of cells.
  static __m512i cornersOf(__m512i cells) {
    return _mm512_or_si512(cells, _mm512_srli_epi64(cells, 1));
  }

  // `crossed_first`: its lowest bit counts.
  HWY_INLINE void number(int axis, std::int64_t r, __mmask8 valid, __mmask8 own, __m512i crossed,
                         __m512i crossed_first) {
    const auto a = static_cast<std::size_t>(axis);
    __m512i count = _mm512_popcnt_epi64(crossed);
    __mmask8 listed = _mm512_test_epi64_mask(crossed, crossed);
    __m512i before_row = _mm512_setzero_si512();
    _mm512_mask_storeu_epi64(rows_.crossed[a].data() + r, valid, crossed);
    if (axis != 0) {
      const __m512i at_first = _mm512_and_si512(crossed_first, _mm512_set1_epi64(1));
      _mm_mask_storeu_epi8(rows_.crossed_first[a - 1].data() + r, valid,
                           _mm512_cvtepi64_epi8(at_first));
      listed = static_cast<__mmask8>(listed | _mm512_test_epi64_mask(at_first, at_first));
      if ((rows_.foreign_sides & 1) == 0) before_row = at_first;
    }
    if (listed == 0) return;
    count = _mm512_maskz_add_epi64(own, count, before_row);
    const __m512i none = _mm512_setzero_si512();
    __m512i sum = _mm512_add_epi64(count, _mm512_alignr_epi64(count, none, 7));
    sum = _mm512_add_epi64(sum, _mm512_alignr_epi64(sum, none, 6));
    sum = _mm512_add_epi64(sum, _mm512_alignr_epi64(sum, none, 4));
    const __m512i first =
        _mm512_add_epi64(_mm512_add_epi64(next_[a], before_row), _mm512_sub_epi64(sum, count));
    _mm256_mask_storeu_epi32(rows_.numbers[a].data() + r, own, _mm512_cvtepi64_epi32(first));
    next_[a] = _mm512_add_epi64(next_[a], _mm512_permutexvar_epi64(_mm512_set1_epi64(7), sum));
    list(r, static_cast<__mmask8>(listed & valid), rows_.crossed_rows[a]);
  }

  static HWY_INLINE void list(std::int64_t r, __mmask8 lanes, RowList& to) {
    const __m256i numbers = _mm256_add_epi32(_mm256_set1_epi32(static_cast<int>(r)),
                                             _mm256_set_epi32(7, 6, 5, 4, 3, 2, 1, 0));
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(to.rows.data() + to.count),
                        _mm256_maskz_compress_epi32(lanes, numbers));
    to.count += static_cast<std::size_t>(std::popcount(static_cast<unsigned>(lanes)));
  }

  HWY_INLINE void countCells(std::int64_t r, __m512i cells) {
    const __mmask8 lanes = _mm512_test_epi64_mask(cells, cells);
    if (lanes == 0) return;
    _mm512_mask_storeu_epi64(rows_.crossed_cells.data() + r, lanes, cells);
    list(r, lanes, rows_.rows_with_crossed_cells);
    cell_count_ += static_cast<std::uint32_t>(_mm512_reduce_add_epi64(_mm512_popcnt_epi64(cells)));
    for (unsigned rest = lanes; rest != 0; rest &= rest - 1) {
      const std::int64_t row = r + std::countr_zero(rest);
      triangles_ += counter_.count(CellWords(rows_, row, 0),
                                   rows_.crossed_cells[static_cast<std::size_t>(row)]);
    }
  }

  BrickRows& rows_;
  const TriangleCounter counter_;
  __m512i next_[3] = {_mm512_setzero_si512(), _mm512_setzero_si512(), _mm512_setzero_si512()};
  std::uint32_t triangles_ = 0, cell_count_ = 0;
};
#endif

// One row after the other.
class SingleRows {
 public:
  SingleRows(BrickRows& rows, const std::uint8_t* triangle_counts)
      : rows_(rows), triangle_counts_(triangle_counts) {}

  void run() {
    rows_.triangles = rows_.crossed_cell_count = 0;
    for (std::int64_t k = 0; k <= rows_.cells.z; ++k)
      for (std::int64_t j = 0; j <= rows_.cells.y; ++j) {
        const std::int64_t r = rows_.row(j, k);
        if (!touchesWanted(r)) continue;  // as most do not around a focus
        for (int axis = 0; axis < 3; ++axis) number(axis, j, k);
        if (j < rows_.cells.y && k < rows_.cells.z) countCells(r);
      }
    for (std::size_t axis = 0; axis < 3; ++axis) rows_.crossings[axis] = next_[axis];
  }

 private:
  bool touchesWanted(std::int64_t r) const {
    const std::int64_t words = rows_.words_per_row, slice = rows_.rowsPerSlice();
    const std::uint64_t *a = rows_.wanted(r), *b = rows_.wanted(r - 1),
                        *c = rows_.wanted(r - slice), *d = rows_.wanted(r - slice - 1);
    std::uint64_t any = 0;
    for (std::int64_t w = 0; w < words; ++w) any |= a[w] | b[w] | c[w] | d[w];
    return any != 0;
  }
  void number(int axis, std::int64_t j, std::int64_t k) {
    const auto a = static_cast<std::size_t>(axis);
    const std::int64_t words = rows_.words_per_row, slice = rows_.rowsPerSlice();
    const std::int64_t r = rows_.row(j, k);
    const auto row = static_cast<std::size_t>(r);
    const std::int64_t to = axis == 0 ? 0 : axis == 1 ? 1 : slice;
    const std::uint64_t* inside = rows_.inside.data() + r * words;
    std::uint64_t* crossed = rows_.crossed[a].data() + r * words;
    const auto nearCells = [&](std::int64_t w) {
      if (w == words) return std::uint64_t{0};
      std::uint64_t near = rows_.wanted(r)[w];
      if (axis != 1) near |= rows_.wanted(r - 1)[w];
      if (axis != 2) near |= rows_.wanted(r - slice)[w];
      if (axis == 0) near |= rows_.wanted(r - slice - 1)[w];
      return near;
    };
    std::uint64_t any = 0, carry = rows_.first_inside[row];
    std::uint32_t count = 0;
    std::uint64_t near = nearCells(0);
    std::uint32_t at_first = 0;
    if (axis != 0) {
      at_first = near & 1 & (carry ^ rows_.first_inside[static_cast<std::size_t>(r + to)]);
      rows_.crossed_first[a - 1][row] = static_cast<std::uint8_t>(at_first);
    }
    for (std::int64_t w = 0; w < words; ++w) {
      const std::uint64_t next_near = nearCells(w + 1);
      if (near == 0 && next_near == 0) {
        crossed[w] = 0;  // bits may be those of an older brick
      } else if (axis == 0) {
        crossed[w] = crossedAlongX(inside[w], carry, near);
      } else {
        crossed[w] = (inside[w] ^ inside[w + to * words]) & (near | near >> 1 | next_near << 63);
      }
      carry = inside[w] >> 63;
      near = next_near;
      any |= crossed[w];
      count += static_cast<std::uint32_t>(std::popcount(crossed[w]));
    }
    if (any == 0 && at_first == 0) return;
    listRow(r, rows_.crossed_rows[a]);
    if (rows_.isForeign(axis, j, k)) return;
    if ((rows_.foreign_sides & 1) == 0) next_[a] += at_first;
    rows_.numbers[a][row] = next_[a];
    next_[a] += count;
  }

  void countCells(std::int64_t r) {
    bool any = false;
    const std::int64_t words = rows_.words_per_row;
    std::uint64_t* cells = rows_.crossed_cells.data() + r * words;
    for (std::int64_t w = 0; w < words; ++w) {
      cells[w] = 0;
      if (rows_.wanted(r)[w] == 0) continue;
      const CellWords c(rows_, r, w);
      cells[w] = c.crossedCells(rows_.wanted(r)[w]);
      any = any || cells[w] != 0;
      rows_.crossed_cell_count += static_cast<std::uint32_t>(std::popcount(cells[w]));
      for (std::uint64_t rest = cells[w]; rest != 0; rest &= rest - 1)
        rows_.triangles += triangle_counts_[c.pattern(std::countr_zero(rest))];
    }
    if (any) listRow(r, rows_.rows_with_crossed_cells);
  }

  BrickRows& rows_;
  const std::uint8_t* triangle_counts_;
  std::uint32_t next_[3] = {0, 0, 0};
};

void numberAll(BrickRows& rows, const std::uint8_t* triangle_counts) {
#if HWY_TARGET == HWY_AVX3_DL
  if (rows.words_per_row == 1) {
    EightRows(rows, triangle_counts).run();
    return;
  }
#endif
  SingleRows(rows, triangle_counts).run();
}

}  // namespace HWY_NAMESPACE
}  // namespace isobrick
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace isobrick {

void BrickRows::resize(const Index3& brick_cells) {
  cells = brick_cells;
  words_per_row = (cells.x + 63) / 64;
  // Eight rows are read and written at once, up to seven beyond the last.
  constexpr std::size_t kBeyond = 8;
  const std::int64_t slice = rowsPerSlice();
  const auto rows = static_cast<std::size_t>(slice * (cells.z + 1));
  const auto words = static_cast<std::size_t>(words_per_row);
  before_ = slice + 1;
  wanted_.assign((rows + static_cast<std::size_t>(before_) + kBeyond) * words, 0);
  compare_too.assign(rows + kBeyond, 0);
  const std::size_t with_next = rows + static_cast<std::size_t>(slice) + 1 + kBeyond;
  inside.resize(with_next * words);
  first_inside.resize(with_next);
  for (auto& axis : crossed) axis.resize((rows + kBeyond) * words);
  for (auto& axis : crossed_first) axis.resize(rows + kBeyond);
  for (auto& axis : numbers) axis.resize(rows + kBeyond);
  for (auto& axis : first_numbers) axis.resize(rows);
  crossed_cells.resize((rows + kBeyond) * words);
  for (RowList* list :
       {&crossed_rows[0], &crossed_rows[1], &crossed_rows[2], &rows_with_crossed_cells}) {
    list->rows.resize(rows + kBeyond);
    list->count = 0;
  }
}

HWY_EXPORT(compareRowsOfType);

template <typename T>
void compareRows(const BrickGrid<T>& grid, T threshold, BrickRows& rows) {
  HWY_DYNAMIC_DISPATCH(compareRowsOfType)(voxelTypeOf<T>(), &grid, &threshold, rows);
}

#define ISOBRICK_INSTANTIATE(T) template void compareRows<T>(const BrickGrid<T>&, T, BrickRows&);
ISOBRICK_FOR_EACH_VOXEL_TYPE(ISOBRICK_INSTANTIATE)
#undef ISOBRICK_INSTANTIATE

HWY_EXPORT(numberAll);

void numberRows(BrickRows& rows) {
  static const std::array<std::uint8_t, 256> counts = [] {
    std::array<std::uint8_t, 256> all;
    for (std::size_t i = 0; i < 256; ++i) all[i] = marchingCubesTable()[i].triangle_count;
    return all;
  }();
  for (RowList& list : rows.crossed_rows) list.count = 0;
  rows.rows_with_crossed_cells.count = 0;
  HWY_DYNAMIC_DISPATCH(numberAll)(rows, counts.data());
}

}  // namespace isobrick
#endif
