// The mesh that is on the screen, read back from the renderer.
#pragma once

#include <vector>

#include "isobrick/extract/sinks/triangle_sink.h"
#include "isobrick/viewer/render/scene_readback.h"

namespace isobrick {

// Passes the renderer's copies of `chunks` to the sink, chunk by chunk. Positions are the same to
// the bit on both sides of a brick, so vertices in the same place of one surface become one vertex:
// a mesh that has a gap on the screen has one in the sink. `frame`: of the pyramid that the chunks
// are of. Normals have the 16 bits that they are drawn with. Passes on exceptions of the sink.
void takeShownMesh(const SceneReadback& renderer, const std::vector<ChunkId>& chunks,
                   const MeshFrame& frame, TriangleSink& sink);

}  // namespace isobrick
