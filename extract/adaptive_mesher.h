// Marching cubes and transition fans on a brick where leaves of several levels meet.
#pragma once

#include "isobrick/extract/active_tiles.h"
#include "isobrick/extract/brick_traversal.h"
#include "isobrick/extract/edge_vertex_map.h"
#include "isobrick/extract/meshing/corner_values.h"
#include "isobrick/extract/meshing/tile_leaves.h"
#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// Meshes the leaves of one level in one brick at a time, tile by tile, and reuses its memory. One
// object serves one thread. What is done to a tile, in this order, has its files in
// extract/meshing/: which cells are leaves, what values their corners have, then leaf by leaf the
// vertices on its edges and its triangles or, beside finer leaves, its fans.
class AdaptiveMesher {
 public:
  // Appends the brick's triangles to `batch`, which is empty.
  void mesh(const MeshContext& context, const BrickWork& work, MeshBatch& batch);

 private:
  template <typename T>
  class Brick;

  ActiveTiles tiles_;
  TileLeaves leaves_;
  TileCorners corners_;
  EdgeVertexMap<std::uint32_t> numbers_;  // of the vertices of the brick at hand
};

}  // namespace isobrick
