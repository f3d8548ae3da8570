// The traversal: from the root down to the bricks that hold leaves the isosurface may cross.
#pragma once

#include <vector>

#include "isobrick/extract/query.h"
#include "isobrick/extract/session/mesh_context.h"

namespace isobrick {

// Visits every brick at most once, top down, prunes by range (rule 7) and by the oracles, and lists
// the remaining bricks, depth first; if all are of level 0, in the order of the brick table: then
// they can be meshed while a volume is read from its first to its last slice. Reads no brick, only
// rows of the brick table.
std::vector<BrickWork> traverseBricks(const MeshContext& context);

// Those of them among these bricks of level 0, for a query of level 0 alone.
std::vector<BrickWork> traverseFinestBricks(const MeshContext& context, const IndexBox& bricks);

}  // namespace isobrick
