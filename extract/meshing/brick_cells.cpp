#include "isobrick/extract/meshing/brick_cells.h"

#include <algorithm>

#include "isobrick/extract/kernels/brick_triangles.h"
#include "isobrick/extract/kernels/row_bits.h"
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
  if (!threshold) {
    // All of it may be inside, if that is below the isovalue.
    if (!context.query.cap) return false;
    std::fill(rows_.inside.begin(), rows_.inside.end(), 0);
    std::fill(rows_.first_inside.begin(), rows_.first_inside.end(), std::uint8_t{0});
    return true;
  }
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

}  // namespace isobrick
