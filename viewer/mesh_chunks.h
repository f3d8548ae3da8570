// A mesh as the chunks of a picture.
#pragma once

#include <vector>

#include "isobrick/viewer/offscreen_renderer.h"
#include "isobrick/viewer/stream/surface_chunk.h"

namespace isobrick {

// A mesh of world positions as chunks of at most 2^18 triangles, with a common origin. Triangles
// are sorted by their levels if `with_levels`. The scene's lattice is the world itself.
std::vector<SurfaceChunk> chunksOf(const RenderMesh& mesh, bool with_levels);

}  // namespace isobrick
