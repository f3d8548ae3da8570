// The parts that a progressive query lacks, in the order in which they help.
#pragma once

#include <vector>

#include "isobrick/extract/oracles/residency_oracle.h"
#include "isobrick/extract/session/mesh_context.h"

namespace isobrick {

// True if the query, were everything resident, would mesh cells of the brick or refine them.
bool isWanted(const MeshContext& context, int level, const Index3& brick);

// Every brick that the query, were everything resident, would mesh cells of or refine, and that is
// not usable; and those that kept the residency oracle from refining. Ordered by the distance from
// the nearest focus or eye of a choice, finest first, and if there is none coarsest first; but the
// coarser bricks beside one that it needs to be usable come before it. Reads nothing.
std::vector<MissingBrick> missingBricks(const MeshContext& context);

}  // namespace isobrick
