// The components of a surface, held against those of the whole mesh in memory.
#include "isobrick/extract/sinks/surface_components.h"

#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/indexed_mesh.h"
#include "isobrick/extract/sinks/mesh_file_sink.h"
#include "tests/extract/random_case.h"
#include "tests/support/field_pyramid.h"
#include "tests/support/hashing_sink.h"
#include "tests/support/mesh_checker.h"
#include "tests/support/mesh_components.h"

namespace isobrick::test {
namespace {

SurfaceComponents componentsOf(const Pyramid& pyramid, const Query& query) {
  ComponentFinder finder(query);
  extractIsosurface(pyramid, query, finder);
  return finder.take();
}

IndexedMesh largest(const Pyramid& pyramid, const Query& query, const SurfaceComponents& components,
                    std::size_t count) {
  IndexedMeshSink sink;
  ComponentFilter filter(components, count, sink);
  extractIsosurface(pyramid, query, filter);
  return sink.takeMesh();
}

TEST(SurfaceComponents, AreaAndVolumeOfBallsAndHollows) {
  // A ball with a hollow, a small ball, and one that the volume's border cuts. Bricks cut them all.
  const TemporaryFolder folder;
  BuildOptions build;
  build.brick_cells = 16;
  GridGeometry geometry;
  geometry.spacing = {0.5, 0.5, 0.5};
  geometry.origin = {1e5, -2e5, 3e5};
  geometry.direction = glm::dmat3(0, 1, 0, -1, 0, 0, 0, 0, 1);
  const auto field = [](const glm::dvec3& p) {
    const double shell = 6 - std::abs(glm::length(p - 40.0) - 24);
    const double small = 8 - glm::length(p - glm::dvec3(85, 20, 20));
    const double cut = 9 - glm::length(p - glm::dvec3(85, 85, 0));
    return std::max({shell, small, cut});
  };
  const Pyramid pyramid(buildField(folder, Index3(97), field, build, geometry));
  Query query;
  query.isovalue = 0;
  const SurfaceComponents components = componentsOf(pyramid, query);
  ASSERT_EQ(components.list().size(), 4u);
  const auto ball = [](double voxels) {
    return 4 * std::numbers::pi / 3 * std::pow(voxels / 2, 3);
  };
  const auto sphere = [](double voxels) { return std::numbers::pi * voxels * voxels; };
  const auto& list = components.list();
  EXPECT_NEAR(list[0].area, sphere(30), 0.01 * sphere(30));
  EXPECT_NEAR(list[0].volume.value(), ball(30), 0.01 * ball(30));
  EXPECT_NEAR(list[1].volume.value(), -ball(18), 0.02 * ball(18));
  EXPECT_NEAR(list[2].volume.value(), ball(8), 0.03 * ball(8));
  EXPECT_FALSE(list[3].volume);
  EXPECT_NEAR(list[3].area, sphere(9) / 2, 0.04 * sphere(9));
  const glm::dvec3 middle = geometry.indexToWorld({85, 20, 20});
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_NEAR(list[2].lower[axis], middle[axis] - 4, 0.1);
    EXPECT_NEAR(list[2].upper[axis], middle[axis] + 4, 0.1);
  }
  EXPECT_EQ(components.countFrom(sphere(17)), 2u);
  EXPECT_EQ(components.countFrom(0), 4u);
  EXPECT_EQ(components.countFrom(1e9), 0u);
  // A box may cut any of them.
  query.box = QueryBox{glm::dvec3(0.0), glm::dvec3(96.0)};
  const SurfaceComponents in_box = componentsOf(pyramid, query);
  EXPECT_EQ(in_box.list().size(), 4u);
  for (const SurfaceComponent& one : in_box.list()) EXPECT_FALSE(one.volume);
}

TEST(SurfaceComponents, AreThoseOfTheWholeMesh) {
  std::size_t components_seen = 0;
  for (int seed = 1; seed <= 60; ++seed) {
    SCOPED_TRACE("mesh " + std::to_string(seed));
    RandomCase random(static_cast<std::uint32_t>(seed));
    const TemporaryFolder folder;
    const Pyramid pyramid(buildRandomPyramid(random, folder, 2));
    const Index3& dims = pyramid.spec().voxels;
    Query query = randomQuery(random, pyramid);
    if (seed % 4 == 0) query.simplify = SimplifyOptions{random.real(0.1, 1)};
    IndexedMeshSink whole;
    extractIsosurface(pyramid, query, whole);
    const SurfaceComponents components = componentsOf(pyramid, query);
    std::vector<std::uint64_t> counts;
    for (const SurfaceComponent& one : components.list()) counts.push_back(one.triangles);
    EXPECT_TRUE(std::ranges::is_sorted(components.list(), std::greater(), &SurfaceComponent::area));
    std::ranges::sort(counts, std::greater());
    ASSERT_EQ(counts, trianglesOfComponents(whole.mesh()));
    components_seen += counts.size();

    // Those that are kept are closed, and all together are the whole.
    const std::size_t kept = counts.size() / 2;
    const IndexedMesh mesh = largest(pyramid, query, components, kept);
    ASSERT_EQ(trianglesOfComponents(mesh).size(), kept);
    const MeshReport report = checkMesh(mesh.positions, mesh.triangles, indexOptions(dims));
    ASSERT_TRUE(report.ok()) << report.summary();
    const IndexedMesh all = largest(pyramid, query, components, counts.size());
    ASSERT_EQ(all.triangles, whole.mesh().triangles);
    ASSERT_EQ(all.positions, whole.mesh().positions);
  }
  EXPECT_GT(components_seen, 100u);
}

TEST(SurfaceComponents, AFileOfNumbersWantsThemFromAStageBeforeIt) {
  const TemporaryFolder folder;
  const Pyramid pyramid(buildField(folder, Index3(20),
                                   [](const glm::dvec3& p) { return 6 - glm::length(p - 10.0); }));
  Query query;
  query.isovalue = 0;
  for (const char* name : {"a.ply", "a.vtp", "a.glb"}) {
    EXPECT_THROW(extractIsosurface(pyramid, query,
                                   *makeMeshFileSink(folder.file(name), {.components = true})),
                 Error)
        << name;
    const SurfaceComponents components = componentsOf(pyramid, query);
    const auto file = makeMeshFileSink(folder.file(name), {.components = true});
    ComponentFilter filter(components, 1, *file);
    extractIsosurface(pyramid, query, filter);
    EXPECT_GT(file->vertices(), 100u);
  }
}

TEST(SurfaceComponents, ThreadsDoNotChangeAByte) {
  const TemporaryFolder folder;
  RandomCase random(7);
  BuildOptions build;
  build.brick_cells = 16;
  ArraySource<float> source(Index3(70), random.field<float>(Index3(70)));
  buildPyramid(source, folder.file("case.isb"), build);
  const Pyramid pyramid(folder.file("case.isb"));
  Query query;
  query.isovalue = 100;
  const auto resultWith = [&](int threads) {
    return tbb::task_arena(threads).execute([&] {
      const SurfaceComponents components = componentsOf(pyramid, query);
      HashingSink sink;
      ComponentFilter filter(components, components.list().size() / 2 + 1, sink);
      extractIsosurface(pyramid, query, filter);
      double sum = 0;
      for (const SurfaceComponent& one : components.list()) sum = sum * 1.7 + one.area;
      return std::pair(sink.value(), sum);
    });
  };
  EXPECT_EQ(resultWith(1), resultWith(4));
}

}  // namespace
}  // namespace isobrick::test
