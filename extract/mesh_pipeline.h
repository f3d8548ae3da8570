// Bricks meshed in parallel and handed on in order.
#pragma once

#include <functional>
#include <vector>

#include "isobrick/extract/brick_traversal.h"
#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// Meshes all of `work` on the calling TBB arena and calls `deliver` for every brick's batch, in the
// order of `work` and never twice at a time, from any thread. A few batches for each thread go
// round, so memory does not grow with the mesh: where `deliver` is slow the meshers wait. Stops
// early, without a word, where the query is cancelled. Rethrows what a mesher or `deliver` throws.
void meshInOrder(const MeshContext& context, const std::vector<BrickWork>& work,
                 const std::function<void(const BrickWork&, const MeshBatch&)>& deliver);

}  // namespace isobrick
