#include "isobrick/extract/meshing/uniform_mesher.h"

#include "isobrick/extract/meshing/shared_vertices.h"
#include "isobrick/storage/voxel_type.h"

namespace isobrick {

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
    if (!context.query.cap) return;
    caps_.begin(context, work, cells, batch);
    caps_.add(cells_, rows, NoOtherLevels());
  });
}

}  // namespace isobrick
