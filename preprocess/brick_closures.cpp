#include "isobrick/preprocess/brick_closures.h"

#include <bit>

#include "isobrick/preprocess/kernels/tile_ranges.h"
#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/voxel_type.h"

namespace isobrick {

template <typename T>
void BrickClosures::include(int level, const Index3& brick, const ValueRange& tiles,
                            const SampleBlock<T>& samples) {
  ranges_[row(level, brick)].include(tiles);
  includeInFiner(level, brick, samples);
}

template <typename T>
void BrickClosures::includeInFiner(int level, const Index3& brick, const SampleBlock<T>& samples) {
  const auto log2 = [](std::int64_t n) { return std::countr_zero(static_cast<std::uint64_t>(n)); };
  const IndexBox cells = layout_.brickCellBox(level, brick);
  CubeRanges<T> cubes;
  // Bricks of level - down are cubes of brick_cells / 2^down cells of this level.
  for (int down = log2(layout_.tileCells()) + 1;
       down <= std::min(level - rows_.firstLevel(), log2(layout_.brickCells())); ++down) {
    if (!rows_.hasLevel(level - down)) continue;
    const std::int64_t edge = layout_.brickCells() >> down;
    cubes.reset(BrickLayout::ceilDivide(cells.count, edge));
    includeClosedCubes(samples, cells, edge, cubes, has_missing_);
    const Index3 first = cells.first / edge;
    std::size_t cube = 0;
    forEachIndex({first, cubes.dims}, [&](const Index3& finer) {
      const ValueRange range = cubes.range(cube++);
      if (contains(rows_.bricks(level - down), finer))
        ranges_[row(level - down, finer)].include(range);
    });
  }
}

#define ISOBRICK_INSTANTIATE(T)                                                  \
  template void BrickClosures::include<T>(int, const Index3&, const ValueRange&, \
                                          const SampleBlock<T>&);                \
  template void BrickClosures::includeInFiner<T>(int, const Index3&, const SampleBlock<T>&);
ISOBRICK_FOR_EACH_VOXEL_TYPE(ISOBRICK_INSTANTIATE)
#undef ISOBRICK_INSTANTIATE

}  // namespace isobrick
