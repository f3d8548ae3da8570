// Marching cubes on a brick that is all leaves of one level.
#pragma once

#include "isobrick/extract/meshing/brick_caps.h"
#include "isobrick/extract/meshing/brick_cells.h"
#include "isobrick/extract/meshing/crossed_tiles.h"
#include "isobrick/extract/session/brick_traversal.h"
#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// Meshes one brick at a time and reuses its memory. One object serves one thread.
class UniformMesher {
 public:
  // Fills `batch`, which is empty.
  void mesh(const MeshContext& context, const BrickWork& work, MeshBatch& batch);

 private:
  CrossedTiles tiles_;
  BrickCells cells_;
  BrickCaps caps_;
};

}  // namespace isobrick
