// The wanted cells of one brick: marching cubes on its samples as they lie in the file, by the
// kernels of extract/kernels/brick_rows.h.
#pragma once

#include "isobrick/extract/kernels/brick_crossings.h"
#include "isobrick/extract/kernels/contour.h"
#include "isobrick/extract/meshing/crossed_tiles.h"
#include "isobrick/extract/session/brick_traversal.h"
#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// Meshes one brick after the other and reuses its memory. One object serves one thread. The order
// of calls: reset(), the caller marks the wanted cells, compare(), the caller may change bits,
// number(), the caller may take cells out of rows().crossed_cells, make().
class BrickCells {
 public:
  // Sizes the rows for a brick; no cell is wanted then.
  void reset(const IndexBox& cells) {
    rows_.resize(cells.count);
    rows_.foreign_sides = 0;
  }
  BrickRows& rows() { return rows_; }

  // Compares the rows that rows() marks. False, without comparing, if no voxel of the type is
  // inside. T: the voxel type.
  template <typename T>
  bool compare(const MeshContext& context, const BrickWork& work, const BrickSamples& samples);
  // Numbers the crossings.
  void number() { numberRows(rows_); }
  // Puts a vertex for every crossing, made of the brick's own samples, and the triangles of the
  // crossed cells into `batch`, which has none yet. A crossing's vertex has its number.
  template <typename T>
  void make(const MeshContext& context, const BrickWork& work, const BrickSamples& samples,
            MeshBatch& batch);

  // The vertex on the edge along `axis` from a corner of a wanted cell, counted from the brick's
  // first, after number(). kNoVertex if it is not crossed.
  std::uint32_t vertexOn(int axis, const Index3& corner) const;

 private:
  BrickRows rows_;
  CornerSpacing spacing_;
};

}  // namespace isobrick
