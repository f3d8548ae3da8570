// Marching cubes and transition fans on a brick where leaves of several levels meet.
#pragma once

#include "isobrick/extract/kernels/edge_crossings.h"
#include "isobrick/extract/meshing/brick_caps.h"
#include "isobrick/extract/meshing/brick_cells.h"
#include "isobrick/extract/meshing/brick_split.h"
#include "isobrick/extract/meshing/crossed_tiles.h"
#include "isobrick/extract/meshing/fans.h"
#include "isobrick/extract/meshing/transition_corners.h"
#include "isobrick/extract/session/brick_traversal.h"
#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// Meshes the leaves of one level in one brick at a time and reuses its memory. One object serves
// one thread. All leaves go through the kernels of uniform bricks, all together. The transition
// zone, which leaves of other levels touch, is corrected before and after: the bits of its corners
// (rule 6), the vertices on its edges (rules 6, 8 and 12), and fans in place of the triangles of
// cells beside finer leaves (rule 10).
class AdaptiveMesher {
 public:
  // Appends the brick's triangles to `batch`, which is empty.
  void mesh(const MeshContext& context, const BrickWork& work, MeshBatch& batch);

 private:
  template <typename T>
  class Brick;
  struct FanCell {
    Index3 cell{0};
    unsigned pattern = 0;  // of its corners
    unsigned finer = 0;    // bit f: beside finer leaves across face f, and crossed there
  };

  CrossedTiles tiles_;
  BrickSplit split_;
  BrickCells cells_;
  TransitionCorners corners_;
  std::vector<FanCell> fan_cells_;
  SeveralFans fans_;
  EdgeQueue edges_;
  BrickCaps caps_;
};

}  // namespace isobrick
