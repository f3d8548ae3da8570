#include "isobrick/extract/uniform_mesher.h"

#include "isobrick/extract/active_rows.h"

namespace isobrick {

void UniformMesher::mesh(const MeshContext& context, const BrickWork& work, MeshBatch& batch) {
  if (!tiles_.load(context, work.level, work.brick)) return;
  const BrickLayout& layout = context.pyramid.layout();
  cells_.reset(layout.brickCellBox(work.level, work.brick));
  wantActiveRows(tiles_, layout.tileCells(), cells_.rows());
  batch.origin =
      brickOrigin(context.lattice(), work.level, layout.brickCellBox(work.level, work.brick));
  const BrickSamples samples = context.samples(work.level, work.brick);
  visitVoxelType(context.pyramid.spec().voxel_type, [&](auto tag) {
    cells_.mesh<typename decltype(tag)::Type>(context, work, samples, batch);
  });
}

}  // namespace isobrick
