// Where triangles go: batch by batch, in an order that no thread count changes.
#pragma once

#include <cstdint>
#include <vector>

#include "isobrick/extract/edge_key.h"
#include "isobrick/storage/grid.h"

namespace isobrick {

// What one brick of one level adds to a mesh.
struct MeshBatch {
  // A vertex that other batches may have too; equal keys are one vertex.
  struct SharedVertex {
    std::uint32_t vertex;  // index into positions
    EdgeKey key;
  };

  int level = 0;
  double fraction_done = 0;              // of the extraction's bricks, with this one: 0 .. 1
  std::vector<glm::dvec3> positions;     // world units
  std::vector<glm::vec3> normals;        // unit, towards lower values; one for every position
  std::vector<std::uint32_t> triangles;  // three indices into positions each, counter-clockwise
                                         // seen from the lower values
  std::vector<SharedVertex> shared;      // ascending in `vertex`
  std::uint64_t cells = 0;               // leaves with at least one triangle
  std::uint64_t transition_cells = 0;    // those of them that have a fan

  void clear() {
    positions.clear();
    normals.clear();
    triangles.clear();
    shared.clear();
    cells = transition_cells = 0;
  }
};

// What a sink may want to know before the first batch.
struct MeshFrame {
  GridGeometry geometry;
  Index3 voxels{0};

  // Greatest magnitude of a world coordinate divided by the least voxel spacing: above 2048, single
  // precision no longer separates crossings that are 1/4096 of an edge apart (rule 8).
  double coordinateMagnitudeInVoxels() const;
};

// Receives a mesh. begin() once, accept() for every batch, finish() once; never two calls at the
// same time, but from any thread. A batch is valid only during the call. What a sink throws ends
// the extraction and reaches its caller; finish() is not called then.
class TriangleSink {
 public:
  virtual ~TriangleSink() = default;
  virtual void begin(const MeshFrame&) {}
  virtual void accept(const MeshBatch& batch) = 0;
  virtual void finish() {}
};

}  // namespace isobrick
