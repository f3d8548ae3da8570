// Fewer triangles for what one brick adds to a mesh, within a distance of it.
#pragma once

#include <array>
#include <cstdint>
#include <glm/mat3x3.hpp>
#include <glm/vec3.hpp>
#include <vector>

#include "isobrick/extract/simplify/corner_table.h"
#include "isobrick/extract/simplify/deviation.h"
#include "isobrick/extract/simplify/edge_costs.h"
#include "isobrick/extract/simplify/quadric.h"
#include "isobrick/extract/simplify/small_components.h"
#include "isobrick/extract/sinks/triangle_sink.h"
#include "isobrick/storage/error.h"

namespace isobrick {

// How far simplification may go, in the space in which distances count: voxels, or the world in
// units of the least spacing.
struct SimplifySpace {
  float distance = 0;         // above 0
  bool drops_small = false;   // components below the distance: see SmallComponents
  glm::mat3 to_space{1.0f};   // from voxels; identity for a distance in voxels
  glm::mat3 to_voxels{1.0f};  // back
};

// Simplifies batches one after the other, with memory that goes round. The result depends on the
// batch alone.
//
// Edges collapse, those first that change the sum of squared distances to the finest triangles
// least, to the place where it is least (Garland and Heckbert 1997). An edge that might bring
// a point further from where it was than the distance does not collapse (DeviationBound). Vertices
// that other batches have among them, and those at borders, never move, so batches fit each other.
class BatchSimplifier {
 public:
  // Afterwards no point of the batch is further than the distance from what it was, and no point of
  // that further from it, but for the rounding of floats and for components that are dropped. The
  // normal of a vertex is the mean of those that became it, by area. Throws Cancelled if that is
  // requested; `cancel` may be null.
  void simplify(const SimplifySpace& space, const CancelFlag* cancel, MeshBatch& batch);

 private:
  struct Candidate {
    float cost;
    std::uint32_t corner;  // of the vertex that goes; the next one is that of the one that stays
  };
  // What is needed together lies in one line of the cache.
  struct alignas(64) Vertex {
    Quadric quadric;            // about the position
    glm::vec3 position{0.0f};   // in space, from the center
    std::uint32_t touched = 0;  // the round in which it last changed
    bool is_shared = false;
    bool is_fixed = false;
    bool is_broken = false;  // no surface there
  };
  static_assert(sizeof(Vertex) == 64);

  void begin(const SimplifySpace& space, const MeshBatch& batch);
  void addPlanes();
  void findCandidates();
  void sortCandidates();
  void collapseCandidates(const CancelFlag* cancel, const MeshBatch& batch);
  bool collapse(std::uint32_t corner, const MeshBatch& batch);
  // The corner whose vertex goes: the corner itself, or that at the other end of its edge.
  std::uint32_t cornerThatGoes(std::uint32_t corner) const;
  // A position in voxels, in the box of the batch.
  glm::vec3 voxelsOf(const glm::vec3& position) const;
  bool findRegion(std::uint32_t corner, const glm::vec3& place);
  bool mayBeElsewhere(const MeshBatch& batch, std::uint32_t a, std::uint32_t b) const;
  bool keepsOthersApart(std::uint32_t corner, const MeshBatch& batch) const;
  void write(MeshBatch& batch);

  SimplifySpace space_;
  glm::vec3 lower_{0.0f}, upper_{0.0f}, center_{0.0f};  // of the batch, in voxels
  CornerTable table_;
  std::vector<Vertex> vertices_;
  std::vector<glm::vec3> normals_;     // of vertices: sums, by area
  std::vector<Deviation> deviations_;  // of triangles
  std::vector<Candidate> candidates_, sorted_;
  std::vector<std::uint32_t> alive_, numbers_;
  std::uint32_t round_ = 0;
  EdgeBlock edges_;
  CollapseRegion region_;
  std::array<std::uint32_t, CollapseRegion::kMostRing> ring_;  // vertices
  DeviationBound bound_;
  SmallComponents small_;
};

}  // namespace isobrick
