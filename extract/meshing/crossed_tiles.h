// The tiles of a brick that the isosurface may cross, or a cap may lie in.
#pragma once

#include <cstring>
#include <vector>

#include "isobrick/extract/kernels/brick_rows.h"
#include "isobrick/extract/session/mesh_context.h"
#include "isobrick/storage/index_loop.h"

namespace isobrick {

// Filled by load(); keeps its memory from brick to brick.
class CrossedTiles {
 public:
  // Reads the brick's tile ranges unless culling is off. Returns false if no tile is crossed.
  bool load(const MeshContext& context, int level, const Index3& brick) {
    dims_ = context.pyramid.layout().brickTiles(level, brick);
    const auto count = static_cast<std::size_t>(elementCount(dims_));
    if (!context.query.cull_by_ranges) {
      crossed_.assign(count, 1);
      return true;
    }
    context.crossedTiles(level, brick, crossed_);
    return std::memchr(crossed_.data(), 1, count) != nullptr;
  }

  const Index3& dims() const { return dims_; }
  // The first crossed of the tiles (x, y, z), and the one behind the last: [0, 0) if there is none.
  struct Span {
    std::int64_t begin = 0, end = 0;
  };
  Span crossedSpan(std::int64_t y, std::int64_t z) const {
    const std::uint8_t* row = crossed_.data() + linearIndex({0, y, z}, dims_);
    const auto count = static_cast<std::size_t>(dims_.x);
    const void* first = std::memchr(row, 1, count);
    if (first == nullptr) return {};
    return {static_cast<const std::uint8_t*>(first) - row,
            static_cast<const std::uint8_t*>(::memrchr(row, 1, count)) - row + 1};
  }
  // The cells, counted in the level, of the tiles (x, y, z) of brick `cells` with x in `span`.
  // `edge`: of a tile, in cells.
  static IndexBox cellsOf(const Span& span, std::int64_t y, std::int64_t z, const IndexBox& cells,
                          std::int64_t edge) {
    const Index3 first = edge * Index3(span.begin, y, z);
    const Index3 last = glm::min(edge * Index3(span.end, y + 1, z + 1), cells.count);
    return {cells.first + first, last - first};
  }
  // Any of the tiles (x, y, z).
  bool isAnyCrossed(std::int64_t y, std::int64_t z) const {
    const std::uint8_t* row = crossed_.data() + linearIndex({0, y, z}, dims_);
    return std::memchr(row, 1, static_cast<std::size_t>(dims_.x)) != nullptr;
  }
  bool isCrossed(const Index3& tile) const {
    return crossed_[static_cast<std::size_t>(linearIndex(tile, dims_))] != 0;
  }

 private:
  Index3 dims_{0};
  std::vector<std::uint8_t> crossed_;
};

// Marks all cells of every row that has a crossed tile as wanted. `rows` has none yet.
inline void wantCrossedRows(const CrossedTiles& tiles, std::int64_t tile_cells, BrickRows& rows) {
  const Index3 dims = tiles.dims();
  for (std::int64_t z = 0; z < dims.z; ++z)
    for (std::int64_t y = 0; y < dims.y; ++y) {
      if (!tiles.isAnyCrossed(y, z)) continue;
      const std::int64_t j_end = std::min((y + 1) * tile_cells, rows.cells.y);
      const std::int64_t k_end = std::min((z + 1) * tile_cells, rows.cells.z);
      for (std::int64_t k = z * tile_cells; k < k_end; ++k)
        for (std::int64_t j = y * tile_cells; j < j_end; ++j)
          for (std::int64_t w = 0; w < rows.words_per_row; ++w)
            rows.wantedCells(j, k)[w] = cellBits(rows.cells.x, w);
    }
}

}  // namespace isobrick
