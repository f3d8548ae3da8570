// From crossed tiles to the rows of cells that the uniform kernel meshes.
#pragma once

#include "isobrick/extract/kernels/brick_bits.h"
#include "isobrick/extract/meshing/crossed_tiles.h"

namespace isobrick {

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
