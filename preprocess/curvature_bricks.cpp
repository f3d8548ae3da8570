#include "isobrick/preprocess/curvature_bricks.h"

#include <algorithm>
#include <cassert>
#include <type_traits>

#include "isobrick/preprocess/kernels/curvature_fit.h"
#include "isobrick/storage/voxel_type.h"

namespace isobrick {
namespace {

// The ranges of the tiles of one row along x, a node at a time. False if all are single values:
// there is nothing to bound.
bool setRanges(const ValueRange* tiles, std::int64_t nodes_per_tile, CurvatureRow& row) {
  bool any = false;
  for (std::int64_t node = 0; node < row.nodes; ++node) {
    const ValueRange& range = tiles[node / nodes_per_tile];
    const auto i = static_cast<std::size_t>(node);
    row.low[i] = range.min;
    row.high[i] = range.max;
    any |= range.min != range.max;
  }
  return any;
}

// The nine rows of voxels of the nodes whose first one has the lowest voxel `first`; none past
// `last`, which is repeated. With `next`, `row` holds the nodes before these along y, which share
// three rows with them.
template <typename T>
void setVoxels(const SampleBlock<T>& samples, const Index3& first, const Index3& last, bool next,
               CurvatureRow& row) {
  const std::int64_t count = last.x - first.x + 1;
  if (next)
    for (std::size_t i = 0; i < 9; i += 3) row.voxels[i].swap(row.voxels[i + 2]);
  for (std::int64_t z = 0; z < 3; ++z)
    for (std::int64_t y = next ? 1 : 0; y < 3; ++y) {
      const T* from =
          &samples.at({first.x, std::min(first.y + y, last.y), std::min(first.z + z, last.z)});
      float* to = row.voxels[static_cast<std::size_t>(3 * z + y)].data();
      for (std::int64_t x = 0; x < count; ++x) to[x] = static_cast<float>(from[x]);
      to[2 * row.nodes] = to[count - 1];
    }
}

}  // namespace

template <typename T>
void brickCurvature(const BrickLayout& layout, const Index3& brick, const SampleBlock<T>& samples,
                    std::span<const ValueRange> tiles, double epsilon,
                    std::vector<std::uint8_t>& codes) {
  const IndexBox cells = layout.brickCellBox(0, brick);
  const Index3 nodes = layout.brickNodes(brick);
  const Index3 tile_count = layout.brickTiles(0, brick);
  const std::int64_t nodes_per_tile = layout.tileCells() / 2;
  assert(static_cast<std::int64_t>(tiles.size()) == elementCount(tile_count));
  const CurvatureFitOptions options = {epsilon, std::is_integral_v<T>};
  codes.assign(static_cast<std::size_t>(3 * elementCount(nodes)), 0);

  CurvatureRow row(nodes.x);
  for (std::int64_t z = 0; z < nodes.z; ++z) {
    bool next = false;
    for (std::int64_t y = 0; y < nodes.y; ++y) {
      const Index3 tile(0, y / nodes_per_tile, z / nodes_per_tile);
      const bool any = setRanges(&tiles[static_cast<std::size_t>(linearIndex(tile, tile_count))],
                                 nodes_per_tile, row);
      if (any) {
        setVoxels(samples, cells.first + Index3(0, 2 * y, 2 * z), cells.end(), next, row);
        fitCurvature(options, row);
        encodeCurvature(row, &codes[static_cast<std::size_t>(3 * linearIndex({0, y, z}, nodes))]);
      }
      next = any;
    }
  }
}

#define ISOBRICK_INSTANTIATE(T)                                                             \
  template void brickCurvature<T>(const BrickLayout&, const Index3&, const SampleBlock<T>&, \
                                  std::span<const ValueRange>, double,                      \
                                  std::vector<std::uint8_t>&);
ISOBRICK_FOR_EACH_VOXEL_TYPE(ISOBRICK_INSTANTIATE)
#undef ISOBRICK_INSTANTIATE

}  // namespace isobrick
