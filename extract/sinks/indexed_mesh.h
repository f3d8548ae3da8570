// A mesh in memory.
#pragma once

#include "isobrick/extract/sinks/vertex_numbering.h"

namespace isobrick {

// Vertices are numbered in the order of first use; every vertex is stored once.
struct IndexedMesh {
  std::vector<glm::dvec3> positions;          // world units
  std::vector<glm::vec3> normals;             // unit, outward
  std::vector<std::uint32_t> triangles;       // three indices each, winding as in MeshBatch
  std::vector<std::uint8_t> triangle_levels;  // pyramid level of each triangle
  std::vector<std::uint8_t> triangle_caps;    // 1 for each that is a cap (Query::cap), 0 for others
};

// Collects a mesh. Throws Error beyond 2^32 - 1 vertices.
class IndexedMeshSink : public TriangleSink {
 public:
  // Records the volume's place in the world.
  void begin(const MeshFrame& frame) override { placement_ = WorldPlacement(frame.geometry); }
  // Adds the batch.
  void place(PlacedBatch& placed) override;
  // The mesh so far; complete after the extraction.
  const IndexedMesh& mesh() const { return mesh_; }
  // Moves the mesh out; the sink is empty of it afterwards.
  IndexedMesh takeMesh() { return std::move(mesh_); }

 private:
  IndexedMesh mesh_;
  WorldPlacement placement_;
  VertexNumbering numbering_;
};

}  // namespace isobrick
