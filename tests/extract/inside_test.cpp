// The side of the object: the same surface, turned round.
#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <utility>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/shares/mesh_share.h"
#include "isobrick/extract/sinks/indexed_mesh.h"
#include "isobrick/extract/sinks/surface_components.h"
#include "tests/extract/random_case.h"
#include "tests/support/field_pyramid.h"
#include "tests/support/file_bytes.h"
#include "tests/support/mesh_checker.h"
#include "tests/support/repetitions.h"

namespace isobrick::test {
namespace {

IndexedMesh meshOf(const Pyramid& pyramid, Query query, InsideOf inside) {
  query.inside = inside;
  IndexedMeshSink sink;
  extractIsosurface(pyramid, query, sink);
  return sink.takeMesh();
}

// Positions to the bit, normals negated to the bit, triangles in their order and turned.
TEST(InsideTest, BelowIsAboveTurnedRound) {
  const int surfaces = repetitions(150);
  std::size_t triangles = 0;
  for (int seed = 1; seed <= surfaces; ++seed) {
    SCOPED_TRACE("mesh " + std::to_string(seed));
    RandomCase random(static_cast<std::uint32_t>(seed));
    const TemporaryFolder folder;
    const Pyramid pyramid(buildRandomPyramid(random, folder, 2));
    const Query query = randomQuery(random, pyramid);
    const IndexedMesh above = meshOf(pyramid, query, InsideOf::kAbove);
    IndexedMesh below = meshOf(pyramid, query, InsideOf::kBelow);
    const PyramidSpec& spec = pyramid.spec();
    const MeshReport report = checkMesh(std::span<const glm::dvec3>(below.positions),
                                        below.triangles, volumeOptions(spec.geometry, spec.voxels));
    if (!query.box) {
      ASSERT_TRUE(report.ok()) << report.summary();
    }
    ASSERT_EQ(below.positions, above.positions);
    for (glm::vec3& normal : below.normals) normal = -normal;
    ASSERT_EQ(below.normals, above.normals);
    for (std::size_t i = 0; i < below.triangles.size(); i += 3)
      std::swap(below.triangles[i + 1], below.triangles[i + 2]);
    ASSERT_EQ(below.triangles, above.triangles);
    triangles += above.triangles.size() / 3;
    // Straight into memory, too.
    Query into_memory = query;
    into_memory.inside = InsideOf::kBelow;
    SurfaceMesh mesh;
    extractIsosurface(pyramid, into_memory, mesh);
    ASSERT_EQ(mesh.triangles().size(), above.triangles.size());
    SurfaceMesh turned;
    extractIsosurface(pyramid, query, turned);
    for (std::size_t i = 0; i < mesh.triangles().size(); i += 3) {
      ASSERT_EQ(mesh.triangles()[i], turned.triangles()[i]);
      ASSERT_EQ(mesh.triangles()[i + 1], turned.triangles()[i + 2]);
    }
    for (std::size_t v = 0; v < mesh.normals().size(); ++v)
      ASSERT_EQ(mesh.normals()[v], -turned.normals()[v]);
  }
  EXPECT_GT(triangles, std::size_t{100} * static_cast<std::size_t>(surfaces));
}

// A level set, negative inside, through all four geometries: turned or mirrored axes.
TEST(InsideTest, ALevelSetEnclosesItsVolume) {
  constexpr double kRadius = 9.3;
  const glm::dvec3 center(14.2, 15.1, 13.7);
  for (const double flip : {1.0, -1.0}) {
    const TemporaryFolder folder;
    GridGeometry geometry;
    geometry.spacing = {0.5, 0.5, 0.5};
    geometry.origin = {-7, 3, 100};
    geometry.direction = glm::dmat3(0, 1, 0, -1, 0, 0, 0, 0, flip);
    const auto pyramid = openField(
        folder, Index3(30), [&](const glm::dvec3& p) { return glm::length(p - center) - kRadius; },
        geometry);
    for (const bool is_simplified : {false, true}) {
      Query query;
      query.focus = FocusSphere{center + 4.0, 7};
      if (is_simplified) query.simplify = SimplifyOptions{0.1};
      const IndexedMesh mesh = meshOf(*pyramid, query, InsideOf::kBelow);
      const MeshReport report =
          checkMesh(std::span<const glm::dvec3>(mesh.positions), mesh.triangles);
      ASSERT_TRUE(report.ok()) << report.summary();
      const double right = 4.0 / 3 * M_PI * std::pow(kRadius * 0.5, 3);
      EXPECT_NEAR(report.volume, right, 0.1 * right);
      for (std::size_t v = 0; v < mesh.normals.size(); ++v) {
        const glm::dvec3 outward =
            glm::normalize(mesh.positions[v] - geometry.indexToWorld(center));
        ASSERT_GT(glm::dot(outward, glm::dvec3(mesh.normals[v])), 0.9);
      }
    }
  }
}

// The wall of a hollow is a cavity on one side, and a body on the other.
TEST(InsideTest, BodiesAndCavitiesChangeTheirPlaces) {
  const TemporaryFolder folder;
  const auto pyramid = openField(folder, Index3(40), [](const glm::dvec3& p) {
    return 4 - std::abs(glm::length(p - 19.6) - 10);  // a shell from 6 to 14
  });
  const auto volumesOf = [&](InsideOf inside) {
    Query query;
    query.inside = inside;
    ComponentFinder finder(query);
    extractIsosurface(*pyramid, query, finder);
    std::vector<double> volumes;
    const SurfaceComponents components = finder.take();
    for (const SurfaceComponent& one : components.list()) volumes.push_back(*one.volume);
    return volumes;
  };
  const std::vector<double> above = volumesOf(InsideOf::kAbove),
                            below = volumesOf(InsideOf::kBelow);
  ASSERT_EQ(above.size(), 2u);
  ASSERT_EQ(below.size(), 2u);
  for (std::size_t i = 0; i < 2; ++i) EXPECT_DOUBLE_EQ(below[i], -above[i]);
  EXPECT_GT(above[0], 0);
  EXPECT_LT(above[1], 0);
}

TEST(InsideTest, SharesAreOfOneSide) {
  const TemporaryFolder folder;
  const auto pyramid =
      openField(folder, Index3(40), [](const glm::dvec3& p) { return glm::length(p - 19.6) - 14; });
  const auto share = [&](InsideOf inside, std::uint32_t number, const char* name) {
    Query query;
    query.inside = inside;
    Extractor extractor(*pyramid);
    const ExtractionPlan plan = extractor.plan(query);
    const NumberRun run = bricksOf(plan, {number, 2});
    const auto sink = makeMeshShareSink(folder.file(name), *pyramid, plan, {number, 2});
    extractor.execute(plan, run.first, run.count, *sink);
    return folder.file(name);
  };
  const std::string one = share(InsideOf::kBelow, 1, "1.isbm");
  const std::string two = share(InsideOf::kBelow, 2, "2.isbm");
  const std::string other = share(InsideOf::kAbove, 2, "other.isbm");
  {
    const auto merged = makeMeshFileSink(folder.file("merged.obj"));
    mergeMeshShares({one, two}, *merged);
    Query query;
    query.inside = InsideOf::kBelow;
    const auto whole = makeMeshFileSink(folder.file("whole.obj"));
    extractIsosurface(*pyramid, query, *whole);
  }
  const std::string whole = readBytes(folder.file("whole.obj"));
  EXPECT_TRUE(readBytes(folder.file("merged.obj")) == whole);
  EXPECT_NE(whole.find("# normals: towards higher values\n"), std::string::npos);
  CountingSink counting;
  try {
    mergeMeshShares({one, other}, counting);
    ADD_FAILURE() << "shares of two sides were merged";
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("inside_below"), std::string::npos) << error.what();
  }
}

}  // namespace
}  // namespace isobrick::test
