// The slow reference mesher: rules 3 to 12 of the design, each written as it is stated, with dense
// arrays and brute force. The fast extractor is tested against it; it shares no code with it.
//
// Everything is in voxel-index coordinates. Lattice points are named by their clamped positions,
// cells by level and index; a cell [c, c+1] * 2^level is cut off at the last voxel.
//
//   ReferencePyramid pyramid = buildReferencePyramid<std::uint8_t>(dims, voxels);
//   ReferenceQuery query;
//   query.iso = 42;
//   query.focus = glm::dvec3(3, 4, 5);
//   query.radius = 2;
//   ReferenceMesh mesh = referenceMesh(pyramid, query);
//
// Infinite samples and NaN (never inside) are allowed; where they leave no t, it is 1/4096. Throws
// std::logic_error where a rule of the design turns out not to hold (a hanging corner, two extents
// of one edge, an untriangulable loop, ...).
#pragma once

#include <array>
#include <compare>
#include <cstdint>
#include <functional>
#include <glm/vec3.hpp>
#include <optional>
#include <span>
#include <vector>

#include "isobrick/storage/grid.h"
#include "tests/support/reference_pyramid.h"

namespace isobrick::test {

// ---- Which cells are extracted (rules 3 to 5) ---------------------------------------------------

struct ReferenceQuery {
  double iso = 0;  // rounded to float before anything is compared with it

  // Focus oracle, voxel indices. Without a focus everything is refined to level 0.
  std::optional<glm::dvec3> focus;
  double radius = 0;

  // Uniform level 0 .. levels - 1 (larger: the coarsest), or -1. Not together with a focus.
  int level = -1;

  // Curvature oracle: true where a level-1 cell that would be refined is extracted as it is. Asked
  // only for cells whose centre is within `radius` of the focus (for all without one).
  std::function<bool(const Index3& level1_cell)> flat;

  // Any further oracle that stands beside these: true where it refines the cell.
  std::function<bool(int level, const Index3& cell)> further;
};

// The level of the leaf that covers each level-0 cell.
struct LeafLevels {
  Index3 cells;  // of level 0
  std::vector<std::int8_t> levels;

  int leafLevelAt(const Index3& level0_cell) const;
};

LeafLevels referenceLeafLevels(const Lattice& lattice, const ReferenceQuery& query);

// The finer of two everywhere: what is extracted where either of two oracles refines.
LeafLevels finerLeafLevels(const LeafLevels& a, const LeafLevels& b);

struct LeafConflict {
  Index3 cell_a, cell_b;  // cells of level_a and level_b
  int level_a = 0, level_b = 0;
  auto operator<=>(const LeafConflict& other) const { return key() <=> other.key(); }
  bool operator==(const LeafConflict& other) const { return key() == other.key(); }

 private:
  std::array<std::int64_t, 8> key() const {
    return {level_a, cell_a.z, cell_a.y, cell_a.x, level_b, cell_b.z, cell_b.y, cell_b.x};
  }
};

// Rule 5 by brute force: every pair of leaves that touch (in a face, an edge or a corner) and
// differ by more than one level; each pair once, the coarser leaf first, sorted. Also reports
// leaves that overlap a part of another leaf's cell, whatever their levels.
std::vector<LeafConflict> auditLeafLevels(const LeafLevels& leaves);

// ---- The mesh (rules 6 to 12) -------------------------------------------------------------------

// Where the surface crosses a lattice edge. The edge's identity is (base, axis): its lower end's
// position and its direction; one base and axis never has two extents in one mesh.
struct ReferenceCrossing {
  Index3 base{0};
  int axis = 0;
  std::int64_t upper = 0;  // position of the edge's higher end along `axis`
  double t = 0;            // in [1/4096, 1 - 1/4096]
  double position = 0;     // along `axis`; along the others it is base's
  glm::dvec3 normal{0};    // unit, voxel-index space, towards lower values

  glm::dvec3 point() const;
};

// Order of ReferenceMesh::crossings: base z, then y, then x, then axis.
bool operator<(const ReferenceCrossing& a, const ReferenceCrossing& b);

struct ReferenceLevelCounts {
  std::int64_t leaves = 0;             // all leaves of this level
  std::int64_t transition_leaves = 0;  // leaves with at least one transition face
  std::int64_t cells = 0;              // leaves that made a triangle
  std::int64_t transition_cells = 0;   // leaves with a piece of the surface in a transition face
  std::int64_t triangles = 0;
};

// Vertices: first the crossings in their order, then the centres of fans. Triangles are
// counter-clockwise seen from lower values. `segments` of every cell's loops are directed
// pairs of crossings: with them, the crossings and the triangle counts a mesh is given up to the
// choice of diagonals inside cells.
struct ReferenceMesh {
  LeafLevels leaves;
  std::vector<ReferenceCrossing> crossings;  // sorted; exactly those that a triangle uses
  std::vector<glm::dvec3> positions;         // crossings[i].point(), then fan centres
  std::vector<std::uint32_t> triangles;      // three indices into positions each
  // Per triangle the leaf that made it.
  std::vector<std::int8_t> triangle_levels;
  std::vector<Index3> triangle_cells;
  // Every segment of a loop as seen from its cell: sorted, indices of crossings. A segment inside
  // the volume appears once each way; one on the border once.
  std::vector<std::array<std::uint32_t, 2>> segments;
  std::vector<ReferenceLevelCounts> level_counts;  // per level

  std::int64_t triangleCount() const { return static_cast<std::int64_t>(triangles.size() / 3); }
  // Centres of fans, which lie on no edge.
  std::int64_t centreCount() const {
    return static_cast<std::int64_t>(positions.size() - crossings.size());
  }
  std::int64_t transitionCellCount() const;
};

ReferenceMesh referenceMesh(const ReferencePyramid& pyramid, const ReferenceQuery& query);
// The same on leaves that come from elsewhere (another oracle). They must obey rule 5.
ReferenceMesh referenceMesh(const ReferencePyramid& pyramid, const LeafLevels& leaves, double iso);

// What closes the surface of the leaves in a box in the box's six planes: the part of their faces
// there that is inside, by marching squares. The box cuts no leaf.
struct ReferenceCaps {
  std::vector<ReferenceLevelCounts>
      level_counts;            // per level: leaves that only have caps, triangles
  std::vector<Index3> points;  // lattice points at corners of polygons, sorted
  double area = 0;             // voxels^2
};
// `below`: the inside is where values are below `iso`. NaN at a corner of a leaf leaves it out.
ReferenceCaps referenceCaps(const ReferencePyramid& pyramid, const LeafLevels& leaves, double iso,
                            const Index3& low, const Index3& high, bool below = false);

// The values of the lattice points at `positions` by rule 6. Each must be a lattice point of one of
// the leaves that touch it.
std::vector<float> referenceValues(const ReferencePyramid& pyramid, const LeafLevels& leaves,
                                   std::span<const Index3> positions);
inline float referenceValue(const ReferencePyramid& pyramid, const LeafLevels& leaves,
                            const Index3& position) {
  return referenceValues(pyramid, leaves, {&position, 1})[0];
}

}  // namespace isobrick::test
