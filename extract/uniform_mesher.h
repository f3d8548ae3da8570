// Marching cubes on a brick whose cells, and all that touch them, are leaves of one level.
#pragma once

#include <array>
#include <vector>

#include "isobrick/extract/active_tiles.h"
#include "isobrick/extract/brick_traversal.h"
#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// Meshes one brick at a time and reuses its memory. One object serves one thread.
//
// The brick is swept slice by slice: signs of a slice, patterns of a row of cells, then the cells
// that the surface crosses. A vertex is made by the first cell that touches its edge, and later
// cells find its number in the sweep's two slices of edges.
class UniformMesher {
 public:
  // Appends the brick's triangles to `batch`, which is empty.
  void mesh(const MeshContext& context, const BrickWork& work, MeshBatch& batch);

 private:
  template <typename T>
  class Sweep;

  ActiveTiles tiles_;
  std::array<std::vector<std::uint8_t>, 2> signs_;               // slices k and k + 1
  std::vector<std::uint8_t> columns_;                            // signs of four rows, bit by bit
  std::vector<std::uint8_t> patterns_;                           // one row of cells
  std::array<std::vector<std::uint32_t>, 2> x_edges_, y_edges_;  // slices k and k + 1
  std::vector<std::uint32_t> z_edges_;                           // between them
  std::vector<std::uint8_t> active_rows_;  // per layer of tiles and row of tiles
};

}  // namespace isobrick
