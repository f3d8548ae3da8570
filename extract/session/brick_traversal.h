// The traversal: from the root down to the bricks that hold leaves the isosurface may cross.
#pragma once

#include <vector>

#include "isobrick/extract/query.h"
#include "isobrick/extract/session/mesh_context.h"

namespace isobrick {

// Visits every brick at most once, top down, prunes by range (rule 7) and by the oracles, and lists
// the remaining bricks, depth first. Reads no brick, only rows of the brick table.
std::vector<BrickWork> traverseBricks(const MeshContext& context);

}  // namespace isobrick
