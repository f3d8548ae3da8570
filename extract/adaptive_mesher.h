// Marching cubes and transition fans on a brick where leaves of several levels meet.
#pragma once

#include "isobrick/extract/active_tiles.h"
#include "isobrick/extract/brick_traversal.h"
#include "isobrick/extract/edge_vertex_map.h"
#include "isobrick/extract/meshing/brick_split.h"
#include "isobrick/extract/meshing/plain_cells.h"
#include "isobrick/extract/meshing/seam_corners.h"
#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// Meshes the leaves of one level in one brick at a time and reuses its memory. One object serves
// one thread. Leaves that only leaves of their level touch go through the kernels of uniform
// bricks, all together; what is left, the seam, tile by tile and leaf by leaf: what values its
// corners have, the vertices on its edges and its triangles or, beside finer leaves, its fans. The
// rules have their files in extract/meshing/.
class AdaptiveMesher {
 public:
  // Appends the brick's triangles to `batch`, which is empty.
  void mesh(const MeshContext& context, const BrickWork& work, MeshBatch& batch);

 private:
  template <typename T>
  class Brick;
  struct SeamCell {
    Index3 cell{0};
    unsigned pattern = 0;  // of its corners
  };

  ActiveTiles tiles_;
  BrickSplit split_;
  PlainCells plain_;
  SeamCorners corners_;
  std::vector<SeamCell> seam_cells_;
  EdgeVertexMap<std::uint32_t> numbers_;  // of the seam's vertices in the brick at hand
};

}  // namespace isobrick
