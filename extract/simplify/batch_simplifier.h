// Fewer triangles for what one brick adds to a mesh, within a distance of it.
#pragma once

#include <cstdint>
#include <glm/mat3x3.hpp>
#include <glm/vec3.hpp>
#include <glm/vec4.hpp>
#include <span>
#include <vector>

#include "isobrick/extract/simplify/patch_distance.h"
#include "isobrick/extract/simplify/surface_patch.h"
#include "isobrick/extract/sinks/triangle_sink.h"
#include "isobrick/storage/cancel.h"

namespace isobrick {

// How far simplification may go, in the space in which distances count.
struct SimplifySpace {
  float distance = 0;         // above 0
  glm::dmat3 to_space{1.0};   // from voxels; identity for a distance in voxels
  glm::dmat3 to_voxels{1.0};  // back
};

// Simplifies batches one after the other, with memory that goes round. The result depends on the
// batch alone.
//
// meshoptimizer collapses edges (Garland and Heckbert 1997); the vertices that remain are moved to
// where the triangles around them fit the finest vertices best; then both distances are proved
// (DistanceProof). Triangles for which a proof fails, and those around a fault of topology, stay as
// they were, and all is done again, until nothing fails. Vertices on the border of the batch, those
// that other batches have among them, are never moved, so that batches fit each other.
class BatchSimplifier {
 public:
  // Afterwards no point of the batch is further than the distance from what it was, and no point of
  // that further from it. Normals are those that the vertices had. A batch for which nothing can be
  // proved stays as it is. Throws Cancelled if that is requested; `cancel` may be null.
  void simplify(const SimplifySpace& space, const CancelFlag* cancel, MeshBatch& batch);

 private:
  // One trial. False if triangles were added to those that stay.
  bool simplifyOnce(const SimplifySpace& space, float target, const MeshBatch& batch);
  void collapse(float target);
  bool refuseFaults(const MeshBatch& batch);
  void findPlaces();
  void fitVertices();
  void settleVertices(const SimplifySpace& space);
  bool proveDistances(float distance);
  // Keeps all finest triangles that have the vertex.
  void keepAround(std::uint32_t vertex);
  void write(MeshBatch& batch) const;

  struct Place {  // of a finest vertex on the simplified patch
    std::uint32_t triangle = SurfacePatch::kNone;
    glm::vec3 weights{0.0f};  // of the triangle's corners
  };

  std::vector<glm::vec3> finest_positions_, positions_;  // in space
  RawVector<glm::vec3> voxels_;                          // what is written: positions_ in voxels
  glm::vec3 lower_{0.0f}, upper_{0.0f};                  // of the batch, in voxels
  SurfacePatch finest_, simplified_;
  std::vector<std::uint8_t> stays_;     // of each finest triangle
  std::vector<std::uint8_t> is_fixed_;  // of each vertex: at a border, or in a triangle that stays
  std::vector<std::uint32_t> indices_, result_;
  std::uint32_t kept_ = 0;  // the first triangles of the result are those that stay
  std::vector<Place> places_;
  std::vector<std::uint32_t> waiting_;
  std::vector<glm::vec4> shifts_;
  std::vector<std::uint32_t> refused_;  // vertices
  DistanceProof proof_;
};

}  // namespace isobrick
