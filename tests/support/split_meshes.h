// Two other ways to mesh an adaptive octree, which the paper compares its fans with: leaves that
// stay as they are, with cracks between them (its Figure 3), and the conforming split (Figures 4
// and 5). For docs/PAPER.md; slow and simple, as the reference mesher is.
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

#include "tests/support/reference_mesher.h"
#include "tests/support/reference_pyramid.h"

namespace isobrick::test {

// Positions are voxel indices; triangles are counter-clockwise seen from lower values.
struct SplitMesh {
  std::vector<glm::dvec3> positions;
  std::vector<std::uint32_t> triangles;       // three indices into positions each
  std::vector<std::uint8_t> triangle_levels;  // of the leaf that made it
  std::int64_t split_leaves = 0;              // that became pyramids and tetrahedra
  std::int64_t split_triangles = 0;           // made in them

  std::int64_t triangleCount() const { return static_cast<std::int64_t>(triangles.size() / 3); }
};

// Marching cubes in every leaf on its own. The values are those of rule 6, so that leaves agree on
// the crossing of an edge, and still there are cracks in their faces. Vertices on half of a coarser
// leaf's edge are not joined with that edge's vertex, though they are in the same place.
SplitMesh crackedMesh(const ReferencePyramid& pyramid, const LeafLevels& leaves, double iso);

// A leaf with a finer leaf at one of its edges is split around its centre, which has the mean of
// its corners' values: each face becomes the base of a pyramid, and each base is cut along its
// hanging points into squares and triangles, the same way from both sides. No point hangs any more,
// so each has the sample of the finest leaf that touches it. The mesh is closed.
SplitMesh conformingSplitMesh(const ReferencePyramid& pyramid, const LeafLevels& leaves,
                              double iso);

}  // namespace isobrick::test
