// Cells that only leaves of their own level touch: plain marching cubes on a brick's samples as
// they lie in the file, by the kernels of extract/kernels/brick_rows.h.
#pragma once

#include <optional>

#include "isobrick/extract/brick_traversal.h"
#include "isobrick/extract/kernels/brick_crossings.h"
#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// Meshes the wanted cells of one brick after the other and reuses its memory. One object serves one
// thread.
class PlainCells {
 public:
  // Sizes the rows for a brick; no cell is wanted then. The caller wants cells (rows()) and calls
  // mesh().
  void reset(const IndexBox& cells) {
    rows_.resize(cells.count);
    rows_.foreign_sides = 0;
  }
  BrickRows& rows() { return rows_; }
  const BrickRows& rows() const { return rows_; }

  // Compares what rows() asks for, and appends the wanted cells to `batch`, which has no vertices
  // yet; lists the vertices on the brick's sides as shared. False where no voxel of the type is
  // inside, and nothing was compared. T: the voxel type.
  template <typename T>
  bool mesh(const MeshContext& context, const BrickWork& work, const BrickSamples& samples,
            MeshBatch& batch);

  // The vertex on the edge along `axis` from corner `corner`, counted from the brick's first: of an
  // edge that a wanted cell touches, after mesh(). None where no wanted cell touches it; kNoVertex
  // where the edge is not crossed.
  std::optional<std::uint32_t> vertexOn(int axis, const Index3& corner) const;

 private:
  BrickRows rows_;
  CornerSpacing spacing_;
};

}  // namespace isobrick
