// Writes the mesh of bricks of one level into memory, all threads side by side.
#pragma once

#include <tbb/enumerable_thread_specific.h>

#include <span>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/kernels/brick_crossings.h"
#include "isobrick/extract/meshing/crossed_tiles.h"
#include "isobrick/extract/query.h"
#include "isobrick/extract/sinks/vertex_numbering.h"
#include "isobrick/extract/surface_mesh.h"

namespace isobrick {

// The memory that stays from query to query.
struct SurfaceWriterMemory {
  struct Worker {
    CrossedTiles tiles;
    BrickRows rows;
    CornerSpacing spacing;
  };
  tbb::enumerable_thread_specific<Worker> workers;
};

// Every brick goes through these steps, the bricks in the order of the work:
//
//   1. count: the bits of its rows, how many crossings and triangles are its own
//   2. its place: behind the brick before it, which has counted by then or soon will
//   3. numbers of crossings on its low sides, from the bricks there, which come earlier in the
//      work; numbers on its high sides, for those that come later
//   4. positions, normals and triangles, straight to their place
//
// A crossing on a side between bricks is that of the brick that comes first, so nothing is joined
// afterwards. A thread waits in 2 and 3 only for bricks that others have begun, and the first
// unfinished brick never waits.
class SurfaceWriter {
 public:
  // Empties `mesh`.
  SurfaceWriter(SurfaceMesh& mesh, const GridGeometry& geometry, SurfaceWriterMemory& memory);

  // True if all bricks are uniform and of one level.
  static bool canWrite(std::span<const BrickWork> work);
  // Returns the counts of the mesh. The mesh is empty after an exception.
  LevelCounts run(const MeshContext& context, std::span<const BrickWork> work);

 private:
  template <typename T>
  class Run;

  SurfaceMesh& mesh_;
  SurfaceWriterMemory& memory_;
};

// Every batch gets its place in order, which takes time only for vertices that other batches may
// have too; the copying is done side by side. The mesh is empty until finish().
class SurfaceJoiner : public TriangleSink {
 public:
  // Empties `mesh`. `numbering` lends its memory.
  SurfaceJoiner(SurfaceMesh& mesh, const GridGeometry& geometry, VertexNumbering& numbering);

  // Throws Error if the mesh grows beyond the greatest vertex number.
  void place(PlacedBatch& placed) override;
  void write(PlacedBatch& placed) override;
  void finish() override;

 private:
  SurfaceMesh& mesh_;
  VertexNumbering& numbering_;
  std::uint64_t triangles_ = 0;
  std::vector<SurfaceMesh::Part> parts_;  // the mesh's memory, until finish()
};

}  // namespace isobrick
