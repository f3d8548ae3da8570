// Does a mesh pass through itself (rule 11: embedded)? In exact arithmetic, whatever the positions.
//
//   EXPECT_EQ(crossingTriangles(positions, triangles).size(), 0u);
//
// mesh_checker.h says whether a mesh is closed; neither implies the other.
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

namespace isobrick::test {

// Numbers of two triangles.
using TrianglePair = std::array<std::size_t, 2>;

// The pairs that have a point in common beside the vertices, and the edge, that they share: they
// cross, touch, or lie on each other. Vertices are shared only if their index is. A triangle
// without area is in a pair with itself. Positions are finite.
std::vector<TrianglePair> crossingTriangles(std::span<const glm::dvec3> positions,
                                            std::span<const std::uint32_t> triangles);

}  // namespace isobrick::test
