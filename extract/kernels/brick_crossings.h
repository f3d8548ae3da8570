// The vertices of a brick: positions and normals of its crossings, in the order of their numbers.
#pragma once

#include "isobrick/extract/kernels/brick_rows.h"
#include "isobrick/extract/kernels/crossing.h"
#include "isobrick/storage/brick_layout.h"

namespace isobrick {

// The places of a brick's corners, and the distances over which their gradients are taken.
struct CornerSpacing {
  // Corner i of one axis. Differences go from the sample `low` to the sample `high` (offsets along
  // the axis, -1 .. 1), which are `distance` voxels apart; one-sided at the volume's border.
  struct Corner {
    float coordinate = 0;  // in voxels, from the brick's origin
    float distance = 1;
    std::int8_t low = 0, high = 0;
  };

  Index3 origin{0};  // voxel that coordinates are counted from; see brickOrigin()
  float voxels = 1;  // 2^level: between regular corners
  std::array<std::vector<Corner>, 3> corners;
  // The corners of which both neighbours are stored and `voxels` away.
  Index3 regular_first{0}, regular_end{0};
  std::array<float, 3> first_coordinate{};  // coordinate of corner i: this + i * voxels

  // Keeps its memory. `samples`: the box that is stored; `cells` lie in it.
  void set(const Lattice& lattice, int level, const IndexBox& cells, const IndexBox& samples);
};

// The position (in voxels from spacing.origin) and the normal (world) of the crossing on the edge
// along `axis` from `corner`.
struct Crossing {
  glm::vec3 position;
  glm::vec3 normal;
};
template <typename T>
Crossing makeCrossing(const BrickGrid<T>& grid, const CornerSpacing& spacing,
                      const WorldFrame& frame, float isovalue, int axis, const Index3& corner);

// All crossings that numberRows() counted: three floats each to `positions` and to `normals`, which
// hold rows.ownCrossings() of them. The same bits as makeCrossing(), on every machine.
template <typename T>
void makeCrossings(const BrickGrid<T>& grid, const BrickRows& rows, const CornerSpacing& spacing,
                   const WorldFrame& frame, float isovalue, float* positions, float* normals);

}  // namespace isobrick
