// Meshes written in place, against the same meshes through a sink.
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstring>
#include <tuple>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/indexed_mesh.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/storage/error.h"
#include "tests/support/array_source.h"
#include "tests/support/child_process.h"
#include "tests/support/mesh_checker.h"
#include "tests/support/random_numbers.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

using CornerPlace = std::array<double, 3>;
using Triangle = std::array<CornerPlace, 3>;

CornerPlace cornerOf(const glm::dvec3& p) { return {p.x, p.y, p.z}; }

// Every triangle from its least corner on; sorted.
template <typename Position>
std::vector<Triangle> sortedTriangles(std::span<const std::uint32_t> triangles, Position&& at) {
  std::vector<Triangle> all;
  for (std::size_t t = 0; t < triangles.size(); t += 3) {
    Triangle triangle;
    for (std::size_t n = 0; n < 3; ++n) triangle[n] = cornerOf(at(triangles[t + n]));
    std::rotate(triangle.begin(), std::min_element(triangle.begin(), triangle.end()),
                triangle.end());
    all.push_back(triangle);
  }
  std::sort(all.begin(), all.end());
  return all;
}

std::vector<glm::dvec3> worldPositions(const SurfaceMesh& mesh) {
  std::vector<glm::dvec3> all;
  for (std::uint64_t v = 0; v < mesh.positions().size(); ++v) all.push_back(mesh.worldPosition(v));
  return all;
}

// Waves and noise, on and off.
std::vector<std::uint16_t> makeField(const Index3& dims, Random& random) {
  const double noise = static_cast<double>(randomInt(random, 0, 2) * 40);
  const double wave = 0.1 + 0.05 * static_cast<double>(randomInt(random, 0, 5));
  std::vector<std::uint16_t> values;
  for (std::int64_t n = 0; n < elementCount(dims); ++n) {
    const glm::dvec3 p(n % dims.x, n / dims.x % dims.y, n / (dims.x * dims.y));
    const double v = 300 +
                     80 * (std::sin(wave * p.x) + std::sin(wave * p.y + 1) + std::cos(wave * p.z)) +
                     noise * static_cast<double>(randomInt(random, 0, 100)) / 100;
    values.push_back(static_cast<std::uint16_t>(v));
  }
  return values;
}

TEST(SurfaceMesh, IsTheMeshOfTheSinkForAnyNumberOfThreads) {
  const TemporaryFolder folder;
  Random random(5);
  SurfaceMesh mesh, again;  // kept from query to query
  std::uint64_t triangles = 0, uniform = 0;
  for (int round = 0; round < 40; ++round) {
    SCOPED_TRACE("round " + std::to_string(round));
    Index3 dims;
    for (int axis = 0; axis < 3; ++axis) dims[axis] = randomInt(random, 2, 40);
    if (round % 10 == 0) dims = {140, 12, 9};
    const std::vector<std::uint16_t> values = makeField(dims, random);
    BuildOptions options;
    options.brick_cells = round % 10 == 0 ? 128 : std::int64_t{4} << randomInt(random, 0, 3);
    options.tile_cells = std::min<std::int64_t>(options.brick_cells, 2 << randomInt(random, 0, 1));
    ArraySource<std::uint16_t> source(dims, values);
    const std::string path = folder.file("mesh.isb");
    buildPyramid(source, path, options);
    const Pyramid pyramid(path);
    Query query;
    query.isovalue = 300.5 + static_cast<double>(randomInt(random, -100, 100));
    query.cull_by_ranges = randomInt(random, 0, 3) > 0;
    if (randomInt(random, 0, 2) == 0)
      query.uniform_level = static_cast<int>(randomInt(random, 0, pyramid.lattice().levels() - 1));
    else if (randomInt(random, 0, 2) == 0)
      query.focus = FocusSphere{glm::dvec3(dims) * 0.4, 4.0};

    IndexedMeshSink sink;
    std::atomic<float> fraction_done{0};
    query.fraction_done = &fraction_done;
    const ExtractionReport expected = extractIsosurface(pyramid, query, sink);
    const float all_done = expected.triangles > 0 ? 1.0F : fraction_done.load();
    EXPECT_EQ(fraction_done.exchange(0), all_done);
    tbb::task_arena one(1), four(4);
    ExtractionReport report;
    four.execute([&] { report = extractIsosurface(pyramid, query, mesh); });
    EXPECT_EQ(fraction_done, all_done);
    one.execute([&] { extractIsosurface(pyramid, query, again); });
    ASSERT_EQ(report.triangles, expected.triangles);
    ASSERT_EQ(report.bricks_active, expected.bricks_active);
    ASSERT_EQ(mesh.positions().size(), sink.mesh().positions.size());
    ASSERT_EQ(mesh.triangles().size(), sink.mesh().triangles.size());
    ASSERT_EQ(
        sortedTriangles(mesh.triangles(), [&](auto v) { return mesh.worldPosition(v); }),
        sortedTriangles(sink.mesh().triangles, [&](auto v) { return sink.mesh().positions[v]; }));
    const MeshReport check =
        checkMesh(worldPositions(mesh), {mesh.triangles().begin(), mesh.triangles().end()},
                  indexOptions(dims));
    ASSERT_TRUE(check.ok()) << check.summary();
    ASSERT_TRUE(std::equal(mesh.triangles().begin(), mesh.triangles().end(),
                           again.triangles().begin(), again.triangles().end()));
    ASSERT_EQ(mesh.positions().size(), again.positions().size());
    ASSERT_EQ(std::memcmp(mesh.positions().data(), again.positions().data(),
                          mesh.positions().size_bytes()),
              0);
    ASSERT_EQ(
        std::memcmp(mesh.normals().data(), again.normals().data(), mesh.normals().size_bytes()), 0);
    triangles += report.triangles;
    uniform += query.focus ? 0 : report.triangles;
  }
  EXPECT_GT(uniform, 10000u);
  EXPECT_GT(triangles, uniform);
}

// If the caller has the two bricks between them, others meet in a line alone.
TEST(SurfaceMesh, BricksThatMeetInALineShareItsVertices) {
  const TemporaryFolder folder;
  const Index3 dims(17, 17, 9);
  ArraySource<float> source(dims, arrayOfField<float>(dims, [](const Index3& i) {
                              return static_cast<double>(i.z) - 4.5;
                            }));
  BuildOptions options;
  options.brick_cells = 8;
  const std::string path = folder.file("plane.isb");
  buildPyramid(source, path, options);
  const Pyramid pyramid(path);
  Query query;
  query.has_brick = [](int, const Index3& brick) { return brick.x != brick.y; };
  SurfaceMesh mesh;
  IndexedMeshSink sink;
  extractIsosurface(pyramid, query, mesh);
  extractIsosurface(pyramid, query, sink);
  EXPECT_EQ(mesh.triangles().size(), sink.mesh().triangles.size());
  EXPECT_EQ(mesh.positions().size(), sink.mesh().positions.size());
}

// Sanitizers hold memory and addresses of their own.
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)

// Memory that is reserved and not used counts nowhere: RLIMIT_DATA bounds what a process may write
// to, as vm.overcommit_memory=2 does for all of them together.
TEST(SurfaceMesh, CountsAsUsedOnlyWhatItHolds) {
  const TemporaryFolder folder;
  Random random(8);
  const Index3 dims(30, 31, 32);
  const std::vector<std::uint16_t> values = makeField(dims, random);
  ArraySource<std::uint16_t> source(dims, values);
  const std::string path = folder.file("mesh.isb");
  buildPyramid(source, path, {});
  Query query;
  query.isovalue = 300.5;
  expectChildLeavesWith(0, [&] {
    tbb::task_arena one(1);  // a child has no other threads
    return one.execute([&] {
      const Pyramid pyramid(path);
      SurfaceMesh mesh;
      rlimit limit{};
      getrlimit(RLIMIT_DATA, &limit);
      limit.rlim_cur = rlim_t{4} << 30;
      if (setrlimit(RLIMIT_DATA, &limit) != 0) return 2;
      const ExtractionReport report = extractIsosurface(pyramid, query, mesh);
      return report.triangles > 0 && mesh.triangles().size() == 3 * report.triangles ? 0 : 3;
    });
  });
}

TEST(SurfaceMesh, WithoutMemoryOrAddressesItIsAnErrorAndTheNextIsWhole) {
  const TemporaryFolder folder;
  Random random(9);
  const Index3 dims(30, 31, 32);
  ArraySource<std::uint16_t> source(dims, makeField(dims, random));
  const std::string path = folder.file("mesh.isb");
  buildPyramid(source, path, {});
  Query query;
  query.isovalue = 300.5;
  for (const auto& [resource, text] :
       {std::pair{RLIMIT_DATA, "no memory for a mesh"}, {RLIMIT_AS, "no address space"}})
    expectChildLeavesWith(0, [&, which = resource, what = text] {
      tbb::task_arena one(1);
      return one.execute([&] {
        const Pyramid pyramid(path);
        Extractor extractor(pyramid);
        SurfaceMesh mesh, other;
        const std::uint64_t triangles = extractor.extract(query, mesh).triangles;
        rlimit before{};
        getrlimit(which, &before);
        rlimit none = before;
        none.rlim_cur = 1 << 20;  // less than there is
        if (setrlimit(which, &none) != 0) return 2;
        std::string message;
        try {
          extractor.extract(query, other);
        } catch (const Error& error) {
          message = error.what();
        }
        setrlimit(which, &before);
        if (message.find(what) == std::string::npos) return 3;
        if (!other.triangles().empty() || !other.positions().empty()) return 4;
        if (extractor.extract(query, other).triangles != triangles) return 5;
        return extractor.extract(query, mesh).triangles == triangles ? 0 : 6;
      });
    });
}

#endif

TEST(SurfaceMesh, WhatWasMovedFromIsEmptyAndTakesTheNextMesh) {
  const TemporaryFolder folder;
  Random random(6);
  const Index3 dims(20, 21, 22);
  const std::vector<std::uint16_t> values = makeField(dims, random);
  ArraySource<std::uint16_t> source(dims, values);
  const std::string path = folder.file("mesh.isb");
  buildPyramid(source, path, {});
  const Pyramid pyramid(path);
  Query query;
  query.isovalue = 300.5;
  SurfaceMesh mesh;
  extractIsosurface(pyramid, query, mesh);
  const std::size_t vertices = mesh.positions().size();
  ASSERT_GT(vertices, 0u);

  SurfaceMesh made(std::move(mesh));
  EXPECT_EQ(made.positions().size(), vertices);
  EXPECT_TRUE(mesh.positions().empty() && mesh.normals().empty() && mesh.triangles().empty());
  EXPECT_TRUE(mesh.parts().empty());
  extractIsosurface(pyramid, query, mesh);
  EXPECT_EQ(mesh.positions().size(), vertices);

  SurfaceMesh assigned;
  assigned = std::move(made);
  EXPECT_EQ(assigned.positions().size(), vertices);
  EXPECT_TRUE(made.positions().empty() && made.parts().empty());
  extractIsosurface(pyramid, query, made);
  EXPECT_TRUE(std::equal(made.triangles().begin(), made.triangles().end(),
                         assigned.triangles().begin(), assigned.triangles().end()));
}

}  // namespace
}  // namespace isobrick::test
