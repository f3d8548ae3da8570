// An extracted mesh against that of the reference mesher.
#pragma once

#include <gtest/gtest.h>

#include <glm/geometric.hpp>
#include <map>
#include <set>
#include <tuple>
#include <utility>
#include <vector>

#include "isobrick/extract/query.h"
#include "isobrick/extract/sinks/indexed_mesh.h"
#include "tests/support/reference_mesher.h"

namespace isobrick::test {

// The same crossings and normals to the bit, contours on all faces, and numbers of triangles.
// `caps`: those that the mesh has too.
inline void expectSameMesh(const IndexedMesh& mesh, const ReferenceMesh& reference,
                           const ExtractionReport& report, const ReferenceCaps& caps = {}) {
  std::int64_t cap_triangles = 0;
  for (const ReferenceLevelCounts& counts : caps.level_counts) cap_triangles += counts.triangles;
  ASSERT_EQ(mesh.triangles.size() / 3,
            static_cast<std::size_t>(reference.triangleCount() + cap_triangles));
  ASSERT_EQ(mesh.positions.size(), reference.positions.size() + caps.points.size());
  using Point = std::tuple<double, double, double>;
  const auto pointOf = [](const glm::dvec3& p) { return Point{p.x, p.y, p.z}; };
  std::map<Point, std::uint32_t> vertex_at;
  for (std::uint32_t v = 0; v < mesh.positions.size(); ++v)
    vertex_at.emplace(pointOf(mesh.positions[v]), v);
  std::vector<std::uint32_t> vertex_of_crossing;
  for (const ReferenceCrossing& crossing : reference.crossings) {
    const auto found = vertex_at.find(pointOf(crossing.point()));
    ASSERT_NE(found, vertex_at.end()) << "a crossing of the reference is missing";
    vertex_of_crossing.push_back(found->second);
    ASSERT_EQ(glm::dvec3(mesh.normals[found->second]), crossing.normal) << "normals differ";
  }
  // The contours on all cell faces, direction included.
  std::set<std::pair<std::uint32_t, std::uint32_t>> edges;
  for (std::size_t t = 0; t < mesh.triangles.size(); t += 3)
    for (std::size_t i = 0; i < 3; ++i)
      edges.emplace(mesh.triangles[t + i], mesh.triangles[t + (i + 1) % 3]);
  for (const auto& segment : reference.segments)
    ASSERT_TRUE(edges.count({vertex_of_crossing[segment[0]], vertex_of_crossing[segment[1]]}) == 1)
        << "a piece of a contour is missing";
  std::uint64_t triangles = 0;
  for (const LevelCounts& counts : report.levels) {
    const ReferenceLevelCounts& expected =
        reference.level_counts[static_cast<std::size_t>(counts.level)];
    const ReferenceLevelCounts of_caps =
        caps.level_counts.empty() ? ReferenceLevelCounts()
                                  : caps.level_counts[static_cast<std::size_t>(counts.level)];
    EXPECT_EQ(counts.cells, static_cast<std::uint64_t>(expected.cells + of_caps.cells));
    EXPECT_EQ(counts.transition_cells, static_cast<std::uint64_t>(expected.transition_cells));
    EXPECT_EQ(counts.triangles, static_cast<std::uint64_t>(expected.triangles + of_caps.triangles));
    EXPECT_EQ(counts.cap_triangles, static_cast<std::uint64_t>(of_caps.triangles));
    triangles += counts.triangles;
  }
  EXPECT_EQ(report.triangles, triangles);
}

// The caps lie in the planes of a box, between its corners; they have the reference's points,
// number of triangles and area.
inline void expectSameCaps(const IndexedMesh& mesh, const ReferenceCaps& caps, const Index3& low,
                           const Index3& high) {
  std::set<std::tuple<double, double, double>> points;
  double area = 0;
  std::int64_t triangles = 0;
  for (std::size_t t = 0; t < mesh.triangle_caps.size(); ++t) {
    const auto at = [&](std::size_t corner) {
      return mesh.positions[mesh.triangles[3 * t + corner]];
    };
    bool is_in_plane = false;
    for (int axis = 0; axis < 3; ++axis)
      for (const double plane : {static_cast<double>(low[axis]), static_cast<double>(high[axis])})
        is_in_plane =
            is_in_plane || (at(0)[axis] == plane && at(1)[axis] == plane && at(2)[axis] == plane);
    ASSERT_EQ(is_in_plane, mesh.triangle_caps[t] == 1) << "triangle " << t;
    if (!is_in_plane) continue;
    ++triangles;
    area += glm::length(glm::cross(at(1) - at(0), at(2) - at(0))) / 2;
    for (std::size_t corner = 0; corner < 3; ++corner)
      points.emplace(at(corner).x, at(corner).y, at(corner).z);
  }
  for (const ReferenceLevelCounts& counts : caps.level_counts) triangles -= counts.triangles;
  EXPECT_EQ(triangles, 0);
  for (const Index3& point : caps.points)
    ASSERT_EQ(points.count({static_cast<double>(point.x), static_cast<double>(point.y),
                            static_cast<double>(point.z)}),
              1u)
        << "a point of the reference's caps is missing";
  EXPECT_NEAR(area, caps.area, 1e-9 * (1 + caps.area));
}

}  // namespace isobrick::test
