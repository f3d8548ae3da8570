// The traversal: from the root down to the bricks that hold leaves the isosurface may cross.
#pragma once

#include <vector>

#include "isobrick/extract/mesh_context.h"

namespace isobrick {

// One brick to mesh.
struct BrickWork {
  int level = 0;
  Index3 brick{0};
  // False where every cell of the brick, and every cell that touches it, is a leaf of this level:
  // plain marching cubes on the samples as they are.
  bool adaptive = false;
};

// Visits every brick at most once, top down, prunes by range (rule 7) and by the oracles, and lists
// what is left, depth first. Reads nothing from the file.
std::vector<BrickWork> traverseBricks(const MeshContext& context);

}  // namespace isobrick
