// Marching cubes on a brick whose cells, and all that touch them, are leaves of one level.
#pragma once

#include "isobrick/extract/meshing/brick_cells.h"
#include "isobrick/extract/meshing/crossed_tiles.h"

namespace isobrick {

// Meshes one brick at a time and reuses its memory. One object serves one thread.
class UniformMesher {
 public:
  // Fills `batch`, which is empty.
  void mesh(const MeshContext& context, const BrickWork& work, MeshBatch& batch);

 private:
  CrossedTiles tiles_;
  BrickCells cells_;
};

}  // namespace isobrick
