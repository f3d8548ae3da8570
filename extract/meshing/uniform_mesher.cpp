#include "isobrick/extract/meshing/uniform_mesher.h"

#include "isobrick/extract/kernels/brick_triangles.h"
#include "isobrick/extract/kernels/row_bits.h"
#include "isobrick/extract/meshing/crossed_tiles.h"
#include "isobrick/extract/meshing/shared_vertices.h"
#include "isobrick/storage/voxel_type.h"

namespace isobrick {
namespace {

template <typename T>
BrickGrid<T> gridOf(const IndexBox& cells, const BrickSamples& samples) {
  return {samples.data<T>(), samples.box.count, cells.first - samples.box.first, cells.count};
}

}  // namespace

template <typename T>
bool BrickCells::compare(const MeshContext& context, const BrickWork& work,
                         const BrickSamples& samples) {
  const auto threshold = insideThreshold<T>(context.isovalue);
  if (!threshold) return false;
  const IndexBox cells = context.pyramid.layout().brickCellBox(work.level, work.brick);
  compareRows(gridOf<T>(cells, samples), *threshold, rows_);
  return true;
}

template <typename T>
void BrickCells::make(const MeshContext& context, const BrickWork& work,
                      const BrickSamples& samples, MeshBatch& batch) {
  if (rows_.ownCrossings() == 0) return;
  const IndexBox cells = context.pyramid.layout().brickCellBox(work.level, work.brick);
  spacing_.set(context.lattice(), work.level, cells, samples.box);
  batch.positions.resize(rows_.ownCrossings());
  batch.normals.resize(rows_.ownCrossings());
  makeCrossings(gridOf<T>(cells, samples), rows_, spacing_, context.frame, context.isovalue,
                &batch.positions[0].x, &batch.normals[0].x);
  batch.triangles.resize(3 * static_cast<std::size_t>(rows_.triangles));
  makeTriangles(rows_, firstVertices(rows_, 0), context.frame.mirrored(), batch.triangles.data());
}

#define ISOBRICK_INSTANTIATE(T)                                                                    \
  template bool BrickCells::compare<T>(const MeshContext&, const BrickWork&, const BrickSamples&); \
  template void BrickCells::make<T>(const MeshContext&, const BrickWork&, const BrickSamples&,     \
                                    MeshBatch&);
ISOBRICK_FOR_EACH_VOXEL_TYPE(ISOBRICK_INSTANTIATE)
#undef ISOBRICK_INSTANTIATE

std::uint32_t BrickCells::vertexOn(int axis, const Index3& corner) const {
  const auto a = static_cast<std::size_t>(axis);
  const std::int64_t r = rows_.row(corner.y, corner.z);
  const std::uint32_t number = rows_.rowNumber(axis, r);
  if (axis != 0 && corner.x == 0)
    return rows_.crossed_first[a - 1][static_cast<std::size_t>(r)] != 0 ? number - 1 : kNoVertex;
  const std::int64_t bit = axis == 0 ? corner.x : corner.x - 1;
  const std::uint64_t* crossed = rows_.crossed[a].data() + r * rows_.words_per_row;
  if ((crossed[bit / 64] >> bit % 64 & 1) == 0) return kNoVertex;
  return number + bitsBelow(crossed, bit);
}

void UniformMesher::mesh(const MeshContext& context, const BrickWork& work, MeshBatch& batch) {
  if (!tiles_.load(context, work.level, work.brick)) return;
  const BrickLayout& layout = context.pyramid.layout();
  const IndexBox cells = layout.brickCellBox(work.level, work.brick);
  BrickRows& rows = cells_.rows();
  cells_.reset(cells);
  wantCrossedRows(tiles_, layout.tileCells(), rows);
  batch.origin = brickOrigin(context.lattice(), work.level, cells);
  const BrickSamples samples = context.samples(work.level, work.brick);
  visitVoxelType(context.pyramid.spec().voxel_type, [&](auto tag) {
    using T = typename decltype(tag)::Type;
    context.checkCancel();
    if (!cells_.compare<T>(context, work, samples)) return;
    cells_.number();
    context.checkCancel();
    batch.cells += rows.crossed_cell_count;
    cells_.make<T>(context, work, samples, batch);
    SharedVertices(rows, context.lattice(), work.level, cells, batch).list();
  });
}

}  // namespace isobrick
