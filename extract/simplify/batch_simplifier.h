// Fewer triangles for what one brick adds to a mesh, within a distance of it.
#pragma once

#include <cstdint>
#include <glm/common.hpp>
#include <glm/mat3x3.hpp>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "isobrick/extract/query.h"
#include "isobrick/extract/self_crossings.h"
#include "isobrick/extract/simplify/batch_group.h"
#include "isobrick/extract/simplify/collapse_region.h"
#include "isobrick/extract/simplify/corner_table.h"
#include "isobrick/extract/simplify/deviation.h"
#include "isobrick/extract/simplify/edge_costs.h"
#include "isobrick/extract/sinks/batch_components.h"
#include "isobrick/extract/sinks/triangle_sink.h"
#include "isobrick/storage/error.h"

namespace isobrick {

// How far simplification may go, in the space in which distances count: the world in units of the
// least spacing, turned as the voxels are.
struct SimplifySpace {
  float distance = 0;         // above 0
  bool drops_small = false;   // components below the distance: see SmallComponents
  glm::mat3 to_space{1.0f};   // from voxels
  glm::mat3 to_voxels{1.0f};  // back

  Index3 voxels{0};  // of level 0

  static SimplifySpace of(const SimplifyOptions& options, const GridGeometry& geometry,
                          const Index3& voxels);
};

// Simplifies batches one after the other, with memory that goes round. The result depends on the
// batch alone.
//
// Vertices become one at the place where the sum of squared distances to the finest triangles is
// least, if it is small (Garland and Heckbert 1997): at first both ends of edges, within a small
// part of the distance; then a vertex and its neighbours where the surface is nearly flat; then all
// edges that may go. Of edges, those of the least sum go before others. Vertices stay apart if a
// point might come further from where it was than the distance (DeviationBound). Vertices that
// other batches have among them never move, so batches fit each other. A vertex of the surface's
// border in the volume's border may become one with its neighbour there. If triangles of what is
// left cross, the batch is simplified again, within less distance around them, and in the end as it
// was there.
class BatchSimplifier {
 public:
  // Afterwards no point of the batch is further than the distance from what it was, and no point of
  // that further from it, but for the rounding of floats and for components that are dropped. The
  // normal of a vertex is the mean of those that became it, by area. Throws Cancelled if that is
  // requested; `cancel` may be null.
  //
  // If `remains` is not null, it gets what simplifyGroup() takes.
  void simplify(const SimplifySpace& space, const CancelFlag* cancel, MeshBatch& batch,
                SimplifyRemains* remains);
  // The same for simplified bricks together: begins at the vertices that were shared. The distance
  // is from what the bricks were before they were simplified.
  void simplifyGroup(const SimplifySpace& space, const CancelFlag* cancel, BatchGroup& group);

 private:
  struct Candidate {
    float cost;
    std::uint32_t gone, kept;  // vertices
    std::uint32_t corner;  // of the vertex that goes; the next one is that of the one that stays
  };
  // What is needed together lies in one line of the cache.
  struct alignas(64) Vertex {
    Quadric quadric;           // about the position
    glm::vec3 position{0.0f};  // in space, from the center
    bool is_shared = false;
    bool is_fixed = false;
    bool is_border = false;  // fixed, but may become its neighbour on the border
    bool is_broken = false;  // no surface there
    bool was_tried = false;  // as the center of a star
  };
  static_assert(sizeof(Vertex) == 64);

  // Until no triangles cross. `seams`: null, or marks of vertices at which edges get their turn;
  // `start`: gives the vertices what they stand for.
  template <typename Start>
  void collapseAll(const SimplifySpace& space, const CancelFlag* cancel, const MeshBatch& batch,
                   const std::vector<std::uint8_t>* seams, const Start& start);
  void begin(const SimplifySpace& space, const MeshBatch& batch);
  void findCapPlanes(const MeshBatch& batch);
  // Vertices of caps stay in the planes of these: moves the place at which vertices become one
  // there. False if they lie in different ones.
  bool keepInCapPlanes(std::span<const std::uint32_t> joined, glm::vec3& voxels);
  void addPlanes();
  // Finds triangles that cross each other or have no area, and halves the distance twice for what
  // was within `reach` of them, in the space. False if there was nothing to halve.
  bool narrowAroundCrossings(const MeshBatch& batch, float reach);

  // Those of vertices that no other star has changed, in the order of the triangles.
  void collapseStars(const CancelFlag* cancel);
  void collapseStar(std::uint32_t corner);

  // In rounds, edges with a cost and those to cost. A candidate keeps its cost as long as nothing
  // changes at its ends.
  void collapseEdges(const CancelFlag* cancel, const MeshBatch& batch);
  // Those that may collapse; if there are marks of vertices, only edges at one that has one.
  void findEdges(const std::vector<std::uint8_t>* marks);
  void addCandidates();
  void sortCandidates();
  void collapseCheapest(const CancelFlag* cancel, const MeshBatch& batch);
  bool collapseEdge(std::uint32_t corner, const MeshBatch& batch);
  void keepUntouched();

  // Vertices of the border, so near to the line between their neighbours there. False if none went.
  bool collapseBorders(const CancelFlag* cancel, const MeshBatch& batch, float most_shift);
  // `corner`: of the vertex, in the first triangle of its fan.
  bool collapseBorder(std::uint32_t corner, const MeshBatch& batch, float most_shift);
  bool becomesNeighbour(std::uint32_t corner, const MeshBatch& batch, bool first,
                        const glm::vec3& place);
  // Whether the edge is there and this round has not changed its ends.
  bool isUntouched(const Candidate& edge) const {
    return touched_[edge.gone] != round_ && touched_[edge.kept] != round_;
  }
  // The corner whose vertex goes: the corner itself, or that at the other end of its edge.
  std::uint32_t cornerThatGoes(std::uint32_t corner) const;
  // The edge that the corner faces; all that the collapse of the region changes.
  void costAgain(std::uint32_t facing);
  void costAgainAround();

  // With that place for the vertex that remains.
  bool mayCollapse(const glm::vec3& place);
  void collapseRegion(std::uint32_t vertex, const glm::vec3& voxels);
  glm::vec3 positionOf(const glm::vec3& voxels) const {
    return space_.to_space * (voxels - center_);
  }
  // A position in voxels, in the box of the batch and on the grid of crossings.
  glm::vec3 voxelsOf(const glm::vec3& position) const;
  glm::ivec3 onGrid(const glm::vec3& voxels) const {
    return glm::ivec3(glm::floor(voxels * grid_steps_ + 0.5f));
  }
  bool mayBeElsewhere(const MeshBatch& batch, std::uint32_t a, std::uint32_t b) const;
  bool keepsOthersApart(std::uint32_t corner, const MeshBatch& batch) const;
  bool keepsBordersApart(const MeshBatch& batch) const;
  // Sides of the volume in which the vertex lies: two bits an axis.
  unsigned bordersOf(const MeshBatch& batch, std::uint32_t vertex) const;
  void write(MeshBatch& batch);
  // After write().
  void writeRemains(SimplifyRemains& remains) const;
  void takeRemains(const SimplifyRemains& remains);

  SimplifySpace space_;
  float distance_ = 0;                                  // how far collapses may go at present
  glm::vec3 lower_{0.0f}, upper_{0.0f}, center_{0.0f};  // of the batch, in voxels
  float grid_steps_ = 1;                                // of the grid of crossings, a voxel
  CornerTable table_;
  std::vector<Vertex> vertices_;
  std::vector<glm::vec3> voxels_;  // of vertices: their places
  // Of vertices: how often the distance was divided there. At kMostNarrowings they stay.
  std::vector<std::uint8_t> narrowings_, next_narrowings_;
  std::vector<std::uint32_t> touched_;    // of vertices: the round in which it last changed or went
  std::vector<glm::vec3> normals_;        // of vertices: sums, by area
  std::vector<std::uint8_t> cap_planes_;  // of vertices, bit `axis`; none if there are no caps
  std::vector<Deviation> deviations_;     // of triangles
  std::vector<Candidate> candidates_, sorted_;
  std::vector<std::uint32_t> to_cost_;  // edges without a cost: a corner that faces each
  std::vector<std::uint32_t> numbers_;
  std::uint32_t round_ = 0;
  EdgeBlock edges_;
  CollapseRegion region_;
  DeviationBound bound_;
  SmallComponents small_;
  SelfCrossings crossings_;
  std::vector<glm::ivec3> grid_positions_;
  std::vector<SelfCrossings::Triangle> left_;  // triangles
};

}  // namespace isobrick
