// What MeshCheck says of meshes on their way is what the mesh checker of the tests says of them
// whole.
#include "isobrick/extract/mesh_check.h"

#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <array>
#include <cmath>
#include <glm/geometric.hpp>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/indexed_mesh.h"
#include "tests/extract/random_case.h"
#include "tests/support/crossing_triangles.h"
#include "tests/support/field_pyramid.h"
#include "tests/support/mesh_checker.h"
#include "tests/support/repetitions.h"
#include "tests/support/two_balls.h"

namespace isobrick::test {
namespace {

void expectAsChecked(const MeshQuality& quality, const IndexedMesh& mesh) {
  const MeshReport report = checkMesh(mesh.positions, mesh.triangles);
  EXPECT_EQ(quality.vertices, static_cast<std::uint64_t>(report.vertices));
  EXPECT_EQ(quality.edges, static_cast<std::uint64_t>(report.edges));
  EXPECT_EQ(quality.triangles, static_cast<std::uint64_t>(report.triangles));
  EXPECT_EQ(quality.open_edges, static_cast<std::uint64_t>(report.open_edges));
  EXPECT_EQ(quality.nonmanifold_edges, static_cast<std::uint64_t>(report.nonmanifold_edges));
  EXPECT_EQ(quality.misoriented_edges, static_cast<std::uint64_t>(report.misoriented_edges));
  EXPECT_EQ(quality.boundary_loops, static_cast<std::uint64_t>(report.border_loops));
  EXPECT_EQ(quality.zero_area, static_cast<std::uint64_t>(report.zero_area_triangles));
  EXPECT_EQ(quality.euler, report.euler);
  EXPECT_NEAR(quality.area, report.area, 1e-6 * report.area);
  if (quality.isClosed()) {
    EXPECT_NEAR(quality.volume, report.volume, 1e-6 * report.area);
  }
}

TEST(MeshCheck, SaysOfRandomMeshesWhatTheCheckerSays) {
  const int meshes = repetitions(100);
  std::uint64_t triangles = 0;
  for (int seed = 0; seed < meshes; ++seed) {
    SCOPED_TRACE("mesh " + std::to_string(seed));
    RandomCase random(static_cast<std::uint32_t>(seed));
    const TemporaryFolder folder;
    const Pyramid pyramid(buildRandomPyramid(random, folder, 2));
    Query query = randomQuery(random, pyramid);
    if (random.chance(0.5)) query.simplify = SimplifyOptions{random.real(0.05, 1.5)};
    IndexedMeshSink sink;
    MeshCheck check(sink);
    const ExtractionReport report = extractIsosurface(pyramid, query, check);
    const MeshQuality quality = check.quality();
    expectAsChecked(quality, sink.mesh());
    EXPECT_EQ(quality.triangles, report.triangles);
    EXPECT_EQ(quality.crossing,
              crossingTriangles(sink.mesh().positions, sink.mesh().triangles).size());
    triangles += quality.triangles;
    tbb::task_arena one(1);
    one.execute([&] {
      CountingSink counting;
      MeshCheck again(counting);
      extractIsosurface(pyramid, query, again);
      EXPECT_EQ(again.quality(), quality);
    });
  }
  EXPECT_GT(triangles, 1'000u * static_cast<unsigned>(meshes) / 100);
}

TEST(MeshCheck, KnowsASolid) {
  const TemporaryFolder folder;
  const auto pyramid = openTwoBalls(folder);
  IndexedMeshSink sink;
  MeshCheck check(sink);
  extractIsosurface(*pyramid, Query{}, check);
  const MeshQuality quality = check.quality();
  EXPECT_TRUE(quality.isSolid());
  EXPECT_EQ(quality.euler, 4);
  EXPECT_EQ(quality.boundary_loops, 0u);
  const double radii = std::pow(kLargeRadius / 2, 3) + std::pow(kSmallRadius / 2, 3);
  EXPECT_NEAR(quality.volume, 4.0 / 3 * 3.14159265 * radii, 0.01 * radii);
  EXPECT_GT(quality.least_angle, 0.0);
  EXPECT_GT(quality.mean_aspect, 1.0);
  EXPECT_GT(quality.worst_aspect, quality.mean_aspect);
}

// A batch of triangles by the numbers of their corners, in voxels.
MeshQuality qualityOf(const std::vector<glm::vec3>& positions,
                      const std::vector<std::uint32_t>& triangles) {
  CountingSink counting;
  MeshCheck check(counting);
  check.begin({{}, Index3(20)});
  PlacedBatch placed;
  placed.batch.positions.assign(positions.begin(), positions.end());
  placed.batch.normals.assign(positions.size(), glm::vec3(0, 0, 1));
  placed.batch.triangles.assign(triangles.begin(), triangles.end());
  check.prepare(placed);
  check.place(placed);
  check.write(placed);
  check.finish();
  return check.quality();
}

TEST(MeshCheck, MeasuresTriangles) {
  const float height = std::sqrt(3.0f) / 2;
  const MeshQuality even = qualityOf({{0, 0, 0}, {1, 0, 0}, {0.5f, height, 0}}, {0, 1, 2});
  EXPECT_NEAR(even.least_angle, 60, 1e-3);
  EXPECT_NEAR(even.mean_aspect, 1, 1e-6);
  EXPECT_EQ(even.open_edges, 3u);
  EXPECT_EQ(even.boundary_loops, 1u);
  EXPECT_EQ(even.euler, 1);
  EXPECT_FALSE(even.isSolid());
  const MeshQuality right = qualityOf({{0, 0, 0}, {4, 0, 0}, {0, 3, 0}}, {0, 1, 2});
  EXPECT_NEAR(right.least_angle, std::asin(0.6) * 180 / 3.14159265358979, 1e-6);
  EXPECT_NEAR(right.worst_aspect, 5 * 12 / (4 * std::sqrt(3.0) * 6), 1e-9);
  EXPECT_NEAR(right.area, 6, 1e-9);
}

TEST(MeshCheck, CountsFaults) {
  const std::vector<glm::vec3> points = {{0, 0, 0}, {2, 0, 0},  {0, 2, 0},       {2, 2, 0},
                                         {0, 0, 2}, {1, 1, -1}, {0.5f, 0.5f, 1}, {1, 0, 0}};
  const MeshQuality twice_the_same_way = qualityOf(points, {0, 1, 2, 1, 2, 3});
  EXPECT_EQ(twice_the_same_way.misoriented_edges, 1u);
  const MeshQuality three_at_an_edge = qualityOf(points, {0, 1, 2, 1, 0, 4, 1, 0, 5});
  EXPECT_EQ(three_at_an_edge.nonmanifold_edges, 1u);
  const MeshQuality flat = qualityOf(points, {0, 7, 1, 0, 1, 2});
  EXPECT_EQ(flat.zero_area, 1u);
  EXPECT_EQ(flat.least_angle, 0.0);
  EXPECT_EQ(flat.crossing, 0u);
  const MeshQuality crossing = qualityOf(points, {0, 1, 2, 4, 5, 6});
  EXPECT_EQ(crossing.crossing, 2u);
  EXPECT_EQ(crossing.boundary_loops, 2u);
}

}  // namespace
}  // namespace isobrick::test
