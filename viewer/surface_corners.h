// A mesh as the graphics card reads it.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>

#include "isobrick/viewer/offscreen_renderer.h"

namespace isobrick {

// A corner of a triangle. Triangles do not share them: that gives each corner its barycentric
// coordinate (from gl_VertexID) and each triangle its level, cuts meshes of any size into pieces
// with 32-bit counts, and costs little beside rasterising in software.
struct SurfaceCorner {
  glm::vec3 position_from_eye;
  std::array<std::int16_t, 3> normal;  // unit = 32767
  std::uint16_t level;
};
static_assert(sizeof(SurfaceCorner) == 20);

// Writes the 3 * count corners of the triangles [first_triangle, first_triangle + count) in order.
// `eye` is in world units and subtracted in double precision. A mesh without normals gets those of
// its facets, one without levels (or with_levels false) level 0.
void fillCorners(const RenderMesh& mesh, std::size_t first_triangle, std::size_t count,
                 const glm::dvec3& eye, bool with_levels, SurfaceCorner* corners);

}  // namespace isobrick
