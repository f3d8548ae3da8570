// Marching cubes and transition fans on a brick where leaves of several levels meet.
#pragma once

#include <optional>
#include <vector>

#include "extract/active_tiles.h"
#include "extract/brick_traversal.h"
#include "extract/edge_vertex_map.h"
#include "extract/sinks/triangle_sink.h"

namespace isobrick {

// Meshes the leaves of one level in one brick at a time, tile by tile. One object serves one
// thread.
class AdaptiveMesher {
 public:
  // Appends the brick's triangles to `batch`, which is empty.
  void mesh(const MeshContext& context, const BrickWork& work, MeshBatch& batch);

 private:
  template <typename T>
  class Brick;

  ActiveTiles tiles_;
  EdgeVertexMap<std::uint32_t> vertices_;  // of the brick at hand
};

}  // namespace isobrick
