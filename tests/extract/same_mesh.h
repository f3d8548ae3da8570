// An extracted mesh against that of the reference mesher.
#pragma once

#include <gtest/gtest.h>

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
inline void expectSameMesh(const IndexedMesh& mesh, const ReferenceMesh& reference,
                           const ExtractionReport& report) {
  ASSERT_EQ(mesh.triangles.size() / 3, static_cast<std::size_t>(reference.triangleCount()));
  ASSERT_EQ(mesh.positions.size(), reference.positions.size());
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
    EXPECT_EQ(counts.cells, static_cast<std::uint64_t>(expected.cells));
    EXPECT_EQ(counts.transition_cells, static_cast<std::uint64_t>(expected.transition_cells));
    EXPECT_EQ(counts.triangles, static_cast<std::uint64_t>(expected.triangles));
    triangles += counts.triangles;
  }
  EXPECT_EQ(report.triangles, triangles);
}

}  // namespace isobrick::test
