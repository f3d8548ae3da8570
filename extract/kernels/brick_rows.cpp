#define HWY_WANT_AVX3_DL
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "isobrick/extract/kernels/brick_rows.cpp"
#include "isobrick/extract/kernels/brick_rows.h"

#include <hwy/foreach_target.h>  // must come before highway.h
#include <hwy/highway.h>

#include <cstring>

#include "isobrick/extract/kernels/brick_bits.h"
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

}  // namespace isobrick
#endif
