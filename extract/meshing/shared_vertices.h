// Which vertices of a brick other bricks may have too.
#pragma once

#include <bit>
#include <cstdint>

#include "isobrick/extract/kernels/brick_rows.h"
#include "isobrick/extract/kernels/row_bits.h"
#include "isobrick/extract/sinks/triangle_sink.h"
#include "isobrick/storage/brick_layout.h"

namespace isobrick {

// The vertices that BrickCells::make() numbered. Edges that only leaves of the brick's level touch
// are shared if they lie in the brick's sides; the caller decides about the others.
class SharedVertices {
 public:
  SharedVertices(const BrickRows& rows, const Lattice& lattice, int level, const IndexBox& cells,
                 MeshBatch& batch)
      : rows_(rows),
        lattice_(lattice),
        level_(level),
        cells_(cells),
        level_cells_(lattice.cells(level)),
        batch_(batch) {}

  // For a brick whose edges only leaves of its level touch.
  void list() {
    list(NoZone(), [](std::uint32_t, int, const Index3&) {});
  }
  // `zone` says which edges other leaves touch, as TransitionCorners does. Instead of listing
  // those, calls visit(vertex, axis, corner) for each of them that is crossed, ascending in
  // `vertex` as the list.
  template <typename Zone, typename Visit>
  void list(const Zone& zone, Visit&& visit) {
    const std::int64_t ny = cells_.count.y, nz = cells_.count.z;
    const std::int64_t words = rows_.words_per_row, last = cells_.count.x - 1;
    for (int axis = 0; axis < 3; ++axis) {
      const auto a = static_cast<std::size_t>(axis);
      std::int64_t k = 0, slice_first = 0;  // of the slice of the row, which ascend
      for (const std::uint32_t r : rows_.crossed_rows[a].list()) {
        while (r >= slice_first + rows_.rowsPerSlice()) {
          slice_first += rows_.rowsPerSlice();
          ++k;
        }
        const std::int64_t j = r - slice_first;
        const bool in_side =
            (axis != 1 && (j == 0 || j == ny)) || (axis != 2 && (k == 0 || k == nz));
        if (const auto edges = zone.edges(axis, r); edges.hasAny()) {
          listRow(axis, j, k, in_side, edges, visit);
        } else if (in_side) {
          listRow(axis, j, k, true, NoEdges(), visit);
        } else if (axis != 0) {  // only its ends are in sides
          const std::uint64_t last_word = rows_.crossed[a][r * words + last / 64];
          if (rows_.crossed_first[a - 1][r] != 0 || (last_word >> last % 64 & 1) != 0)
            listRow(axis, j, k, false, NoEdges(), visit);
        }
      }
    }
  }

 private:
  struct NoEdges {
    static bool hasAny() { return false; }
    static bool atFirst() { return false; }
    static std::uint64_t word(std::int64_t) { return 0; }
  };
  struct NoZone {
    static NoEdges edges(int, std::int64_t) { return {}; }
  };

  // `all`: the row lies in a side; otherwise only its ends do. `zone`: those edges of it.
  template <typename Edges, typename Visit>
  void listRow(int axis, std::int64_t j, std::int64_t k, bool all, const Edges& zone,
               Visit&& visit) {
    const auto a = static_cast<std::size_t>(axis);
    const std::int64_t words = rows_.words_per_row;
    const std::int64_t r = rows_.row(j, k);
    const std::uint64_t* crossed = rows_.crossed[a].data() + r * words;
    const std::uint32_t number = rows_.rowNumber(axis, r);
    if (axis != 0 && rows_.crossed_first[a - 1][static_cast<std::size_t>(r)] != 0) {
      if (zone.atFirst())
        visit(number - 1, axis, Index3(0, j, k));
      else
        add(number - 1, axis, {0, j, k});
    }
    for (std::int64_t w = 0; w < words; ++w) {
      const std::uint64_t others = zone.word(w);
      std::uint64_t own = ~std::uint64_t{0};  // in the brick's sides
      if (!all) own = axis == 0 ? 0 : bitsBetween(cells_.count.x - 1, cells_.count.x, w);
      for (std::uint64_t rest = crossed[w] & (others | own); rest != 0; rest &= rest - 1) {
        const int bit = std::countr_zero(rest);
        const Index3 corner(64 * w + bit + (axis == 0 ? 0 : 1), j, k);
        const std::uint32_t vertex = number + bitsBelow(crossed, 64 * w + bit);
        if ((others >> bit & 1) != 0)
          visit(vertex, axis, corner);
        else
          add(vertex, axis, corner);
      }
    }
  }
  // The bricks that have the edge.
  int bricksAround(const Index3& corner, int axis) const {
    int bricks = 1;
    for (int a = 0; a < 3; ++a)
      if (a != axis && ((corner[a] == 0 && cells_.first[a] > 0) ||
                        (corner[a] == cells_.count[a] && cells_.end()[a] < level_cells_[a])))
        bricks *= 2;
    return bricks;
  }
  void add(std::uint32_t vertex, int axis, const Index3& corner) {
    const int batches = bricksAround(corner, axis);
    if (batches > 1)
      batch_.shared.push_back(
          {vertex, static_cast<std::uint8_t>(batches),
           makeEdgeKey(lattice_.position(level_, cells_.first + corner), axis)});
  }

  const BrickRows& rows_;
  const Lattice& lattice_;
  const int level_;
  const IndexBox cells_;
  const Index3 level_cells_;
  MeshBatch& batch_;
};

}  // namespace isobrick
