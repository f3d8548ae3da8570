#include "isobrick/extract/meshing/plain_cells.h"

#include <bit>

#include "isobrick/extract/kernels/brick_triangles.h"
#include "isobrick/extract/kernels/contour.h"
#include "isobrick/extract/row_bits.h"
#include "isobrick/storage/voxel_type.h"

namespace isobrick {
namespace {

// Lists the crossings on the brick's sides, which other bricks may have too.
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

  void list() {
    const std::int64_t ny = cells_.count.y, nz = cells_.count.z;
    for (int axis = 0; axis < 3; ++axis)
      for (const std::uint32_t r : rows_.crossed_rows[static_cast<std::size_t>(axis)].list()) {
        const std::int64_t k = r / rows_.rowsPerSlice(), j = r % rows_.rowsPerSlice();
        const bool in_side =
            (axis != 1 && (j == 0 || j == ny)) || (axis != 2 && (k == 0 || k == nz));
        if (axis == 0 && !in_side) continue;
        listRow(axis, j, k, in_side);
      }
  }

 private:
  // `all`: the row lies in a side; otherwise only its ends do.
  void listRow(int axis, std::int64_t j, std::int64_t k, bool all) {
    const auto a = static_cast<std::size_t>(axis);
    const std::int64_t words = rows_.words_per_row;
    const auto r = static_cast<std::size_t>(rows_.row(j, k));
    const std::uint64_t* crossed = rows_.crossed[a].data() + rows_.row(j, k) * words;
    std::uint32_t number = rows_.numbers[a][r];
    for (std::size_t before = 0; before < a; ++before) number += rows_.crossings[before];
    if (axis != 0 && rows_.crossed_first[a - 1][r] != 0) add(number - 1, axis, {0, j, k});
    for (std::int64_t w = 0; w < words; ++w)
      for (std::uint64_t rest = crossed[w]; rest != 0; rest &= rest - 1, ++number) {
        const std::int64_t i = 64 * w + std::countr_zero(rest) + (axis == 0 ? 0 : 1);
        if (all || i == cells_.count.x) add(number, axis, {i, j, k});
      }
  }
  // The bricks that have the edge: only leaves of this level touch it.
  int bricksAround(const Index3& corner, int axis) const {
    int bricks = 1;
    for (int a = 0; a < 3; ++a)
      if (a != axis && ((corner[a] == 0 && cells_.first[a] > 0) ||
                        (corner[a] == cells_.count[a] && cells_.end()[a] < level_cells_[a])))
        bricks *= 2;
    return bricks;
  }
  void add(std::uint32_t number, int axis, const Index3& corner) {
    const int batches = bricksAround(corner, axis);
    if (batches > 1)
      batch_.shared.push_back(
          {number, static_cast<std::uint8_t>(batches),
           makeEdgeKey(lattice_.position(level_, cells_.first + corner), axis)});
  }

  const BrickRows& rows_;
  const Lattice& lattice_;
  const int level_;
  const IndexBox cells_;
  const Index3 level_cells_;
  MeshBatch& batch_;
};

}  // namespace

template <typename T>
bool PlainCells::mesh(const MeshContext& context, const BrickWork& work,
                      const BrickSamples& samples, MeshBatch& batch) {
  const IndexBox cells = context.pyramid.layout().brickCellBox(work.level, work.brick);
  const auto threshold = insideThreshold<T>(context.isovalue);
  if (!threshold) return false;
  const BrickGrid<T> grid = {samples.data<T>(), samples.box.count, cells.first - samples.box.first,
                             cells.count};
  compareRows(grid, *threshold, rows_);
  numberRows(rows_);
  batch.cells += rows_.active_cells;
  if (rows_.ownCrossings() == 0) return true;

  spacing_.set(context.lattice(), work.level, cells, samples.box);
  batch.positions.resize(rows_.ownCrossings());
  batch.normals.resize(rows_.ownCrossings());
  makeCrossings(grid, rows_, spacing_, context.frame, context.isovalue, &batch.positions[0].x,
                &batch.normals[0].x);
  batch.triangles.resize(3 * static_cast<std::size_t>(rows_.triangles));
  makeTriangles(rows_, firstVertices(rows_, 0), context.frame.mirrored(), batch.triangles.data());
  SharedVertices(rows_, context.lattice(), work.level, cells, batch).list();
  return true;
}

#define ISOBRICK_INSTANTIATE(T)                                                                \
  template bool PlainCells::mesh<T>(const MeshContext&, const BrickWork&, const BrickSamples&, \
                                    MeshBatch&);
ISOBRICK_FOR_EACH_VOXEL_TYPE(ISOBRICK_INSTANTIATE)
#undef ISOBRICK_INSTANTIATE

std::optional<std::uint32_t> PlainCells::vertexOn(int axis, const Index3& corner) const {
  const std::int64_t words = rows_.words_per_row, slice = rows_.rowsPerSlice();
  const std::int64_t r = rows_.row(corner.y, corner.z);
  // Cells around the edge: in rows beside it and, across x, on both sides of the corner.
  const auto isWanted = [&](std::int64_t row, std::int64_t i) {
    return i >= 0 && i < rows_.cells.x && (rows_.wanted(row)[i / 64] >> i % 64 & 1) != 0;
  };
  const auto anyWanted = [&](std::int64_t row) {
    return isWanted(row, corner.x) || (axis != 0 && isWanted(row, corner.x - 1));
  };
  if (!anyWanted(r) && !(axis != 1 && anyWanted(r - 1)) && !(axis != 2 && anyWanted(r - slice)) &&
      !(axis == 0 && anyWanted(r - slice - 1)))
    return std::nullopt;

  const auto a = static_cast<std::size_t>(axis);
  const auto row = static_cast<std::size_t>(r);
  std::uint32_t number = rows_.numbers[a][row];
  for (std::size_t before = 0; before < a; ++before) number += rows_.crossings[before];
  if (axis != 0 && corner.x == 0)
    return rows_.crossed_first[a - 1][row] != 0 ? number - 1 : kNoVertex;
  const std::int64_t bit = axis == 0 ? corner.x : corner.x - 1;
  const std::uint64_t* crossed = rows_.crossed[a].data() + r * words;
  if ((crossed[bit / 64] >> bit % 64 & 1) == 0) return kNoVertex;
  for (std::int64_t w = 0; w < bit / 64; ++w)
    number += static_cast<std::uint32_t>(std::popcount(crossed[w]));
  return number + static_cast<std::uint32_t>(std::popcount(crossed[bit / 64] & lowBits(bit % 64)));
}

}  // namespace isobrick
