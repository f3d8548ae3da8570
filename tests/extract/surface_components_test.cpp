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
#include "tests/support/random_numbers.h"

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
  // The shell's outer wall comes with the inner one; the half ball is the smallest body.
  EXPECT_NEAR(list[3].enclosed.value(), ball(9) / 2, 0.03 * ball(9));
  EXPECT_EQ(components.largest(1), (std::vector<std::uint8_t>{1, 1, 0, 0}));
  EXPECT_EQ(components.largest(2), (std::vector<std::uint8_t>{1, 1, 1, 0}));
  EXPECT_EQ(components.largest(9, sphere(29)), (std::vector<std::uint8_t>{1, 1, 0, 0}));
  EXPECT_EQ(components.countFrom(sphere(17)), 2u);
  EXPECT_EQ(components.countFrom(0), 4u);
  EXPECT_EQ(components.countFrom(1e9), 0u);
  // A box may cut any of them.
  query.box = QueryBox{glm::dvec3(0.0), glm::dvec3(96.0)};
  const SurfaceComponents in_box = componentsOf(pyramid, query);
  EXPECT_EQ(in_box.list().size(), 4u);
  for (const SurfaceComponent& one : in_box.list()) EXPECT_FALSE(one.volume || one.enclosed);
  EXPECT_EQ(in_box.largest(2), (std::vector<std::uint8_t>{1, 1, 0, 0}));  // of the largest area
}

// It has nearly all of the volume on its inner side, and is no body of that size.
TEST(SurfaceComponents, APocketAtTheBorderEnclosesItself) {
  const TemporaryFolder folder;
  const Index3 dims(40);
  const auto field = [](const glm::dvec3& p) {
    const double body = 30 - glm::length(p - glm::dvec3(20, 20, 0));
    const double pocket = glm::length(p - glm::dvec3(20, 0, 3)) - 4;
    return std::min(body, pocket);
  };
  const Pyramid pyramid(buildField(folder, dims, field, {}, {}));
  Query query;
  query.isovalue = 0;
  const SurfaceComponents components = componentsOf(pyramid, query);
  ASSERT_GT(components.list().size(), 1u);
  EXPECT_EQ(components.largest(1)[0], 1);
  EXPECT_LT(components.list().back().enclosed.value(), 300);
}

// Balls and slabs that leave the volume on every side, against sums over fine samples.
TEST(SurfaceComponents, EncloseWithTheBorderOfTheVolume) {
  const TemporaryFolder folder;
  const Index3 dims(21, 18, 16);
  const glm::dvec3 last(dims - Index3(1));
  Random random(3);
  int open = 0;
  for (int n = 0; n < 60; ++n) {
    const glm::dvec3 way(randomReal(random, -1, 1), randomReal(random, -1, 1),
                         randomReal(random, -1, 1));
    const glm::dvec3 middle = last * glm::dvec3(randomReal(random, 0, 1), randomReal(random, 0, 1),
                                                randomReal(random, 0, 1));
    const double size = randomReal(random, 3, 9);
    const double sign = n % 4 == 3 ? -1 : 1;
    const auto field = [&](const glm::dvec3& p) {
      if (n % 2 == 0) return sign * (size - glm::length(p - middle));
      return sign * (size / 2 - std::abs(glm::dot(p - middle, glm::normalize(way))));
    };
    GridGeometry geometry;
    geometry.spacing = {0.5, 1, 2};
    if (n % 3 == 0) geometry.direction = glm::dmat3(-1, 0, 0, 0, 1, 0, 0, 0, 1);
    BuildOptions build;
    build.brick_cells = 8;
    const Pyramid pyramid(buildField(folder, dims, field, build, geometry));
    Query query;
    query.isovalue = 0;
    const SurfaceComponents components = componentsOf(pyramid, query);
    if (components.list().size() != 1) continue;
    constexpr int kParts = 4;
    double inside = 0, all = 0;
    for (double z = 0.5 / kParts; z < last.z; z += 1.0 / kParts)
      for (double y = 0.5 / kParts; y < last.y; y += 1.0 / kParts)
        for (double x = 0.5 / kParts; x < last.x; x += 1.0 / kParts, ++all)
          inside += field({x, y, z}) >= 0 ? 1 : 0;
    // The lesser of both sides: see APocketAtTheBorderEnclosesItself.
    const double expected = std::min(inside, all - inside) / all * last.x * last.y * last.z;
    EXPECT_NEAR(components.list()[0].enclosed.value(), expected, 0.03 * expected + 20) << n;
    open += components.list()[0].volume ? 0 : 1;
  }
  EXPECT_GT(open, 20);
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
  const MeshFileOptions numbered{
      .attributes = {{.name = "component", .type = AttributeType::kUint32}}};
  for (const char* name : {"a.ply", "a.vtp", "a.glb"}) {
    EXPECT_THROW(extractIsosurface(pyramid, query, *makeMeshFileSink(folder.file(name), numbered)),
                 Error)
        << name;
    const SurfaceComponents components = componentsOf(pyramid, query);
    const auto file = makeMeshFileSink(folder.file(name), numbered);
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
