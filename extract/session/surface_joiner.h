// Batches of bricks of several levels joined to a mesh in memory.
#pragma once

#include "isobrick/extract/sinks/vertex_numbering.h"
#include "isobrick/extract/surface_mesh.h"

namespace isobrick {

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
