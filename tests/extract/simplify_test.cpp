// Simplified meshes of random volumes and queries: closed as before, within the distance both ways,
// the same for any number of threads. ISOBRICK_SIMPLIFY_MESHES sets the number of meshes.
#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <string>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/indexed_mesh.h"
#include "isobrick/storage/error.h"
#include "tests/extract/random_case.h"
#include "tests/support/crossing_triangles.h"
#include "tests/support/field_pyramid.h"
#include "tests/support/hashing_sink.h"
#include "tests/support/mesh_checker.h"
#include "tests/support/mesh_components.h"
#include "tests/support/repetitions.h"
#include "tools/bench/surface_distance.h"

namespace isobrick::test {
namespace {

// distanceFrom() leaves out a voxel at the border of a volume, so nothing is put there.
constexpr double kMargin = 8;

PlainMesh plainMesh(const IndexedMesh& mesh) {
  PlainMesh plain;
  for (const glm::dvec3& p : mesh.positions)
    plain.positions.push_back({static_cast<float>(p.x + kMargin), static_cast<float>(p.y + kMargin),
                               static_cast<float>(p.z + kMargin)});
  for (std::size_t t = 0; t < mesh.triangles.size(); t += 3)
    plain.triangles.push_back({mesh.triangles[t], mesh.triangles[t + 1], mesh.triangles[t + 2]});
  return plain;
}

IndexedMesh meshOfQuery(const Pyramid& pyramid, const Query& query) {
  IndexedMeshSink sink;
  extractIsosurface(pyramid, query, sink);
  return sink.mesh();
}

double greatestDistance(const PlainMesh& from, const PlainMesh& to, const Index3& voxels) {
  const DistanceOptions options{.most_points = std::numeric_limits<std::int32_t>::max(),
                                .voxels = voxels + Index3(static_cast<std::int64_t>(4 * kMargin))};
  return distanceFrom(from, to, options).max;
}

TEST(Simplify, RandomMeshesStayClosedAndNear) {
  const int meshes = repetitions(120);
  std::size_t triangles = 0, simplified_triangles = 0;
  for (int n = 0; n < meshes; ++n) {
    // In 658 a neighbour had the triangle that a collapse on the border would have made.
    const int seed = n == 0 ? 658 : n;
    SCOPED_TRACE("mesh " + std::to_string(seed));
    RandomCase random(static_cast<std::uint32_t>(seed));
    const TemporaryFolder folder;
    const Pyramid pyramid(buildRandomPyramid(random, folder, 3));
    const Index3& dims = pyramid.spec().voxels;
    Query query = randomQuery(random, pyramid);
    const IndexedMesh finest = meshOfQuery(pyramid, query);
    query.simplify = SimplifyOptions{random.real(0.05, 1.5)};
    const IndexedMesh mesh = meshOfQuery(pyramid, query);
    triangles += finest.triangles.size() / 3;
    simplified_triangles += mesh.triangles.size() / 3;

    const MeshReport report = checkMesh(mesh.positions, mesh.triangles, indexOptions(dims));
    ASSERT_TRUE(report.ok()) << report.summary();
    ASSERT_EQ(finest.triangles.empty(), mesh.triangles.empty());
    if (finest.triangles.empty()) continue;
    const PlainMesh from = plainMesh(mesh), to = plainMesh(finest);
    const double most = query.simplify->distance + 1e-3;
    ASSERT_LE(greatestDistance(from, to, dims), most);
    ASSERT_LE(greatestDistance(to, from, dims), most);
  }
  EXPECT_GT(triangles, 10'000u * static_cast<unsigned>(meshes) / 120);
  EXPECT_LT(simplified_triangles, triangles * 9 / 10);
}

Query sphereQuery(double distance) {
  Query query;
  query.isovalue = 0;
  if (distance > 0) query.simplify = SimplifyOptions{distance};
  return query;
}

// Of one brick, so that all pieces are of one, with values that make thin walls and flat faces.
std::string fewValues(const TemporaryFolder& folder, RandomCase& random, std::int64_t brick_cells) {
  BuildOptions options;
  options.brick_cells = brick_cells;
  return buildField(
      folder, Index3(random.uniform(6, 17), random.uniform(6, 17), random.uniform(6, 17)),
      [&](const glm::dvec3&) { return random.uniform(-1, 1); }, options);
}

// From border to border: the border's vertices go too, but for its ends in the volume's edges.
TEST(Simplify, APlaneNeedsTwoTriangles) {
  const TemporaryFolder folder;
  for (const glm::dvec3& normal : {glm::dvec3(0.05, 0.11, 1), glm::dvec3(0, 0, 1)}) {
    const Pyramid pyramid(buildField(folder, Index3(64), [&](const glm::dvec3& p) {
      return glm::dot(p - glm::dvec3(31.3, 30.7, 31.5), normal);
    }));
    Query query;
    query.simplify = SimplifyOptions{0.1};
    const IndexedMesh mesh = meshOfQuery(pyramid, query);
    EXPECT_EQ(mesh.triangles.size(), 6u);
    const MeshReport report =
        checkMesh(mesh.positions, mesh.triangles, indexOptions(pyramid.spec().voxels));
    EXPECT_TRUE(report.ok()) << report.summary();
    for (const glm::dvec3& p : mesh.positions)
      for (const int axis : {0, 1}) EXPECT_TRUE(p[axis] == 0 || p[axis] == 63) << p[axis];
  }
}

// The seams of bricks and of cubes of bricks cost next to nothing on flat faces.
TEST(Simplify, ABlockNeedsFewTriangles) {
  const TemporaryFolder folder;
  BuildOptions options;
  options.brick_cells = 32;
  const glm::dvec3 middle(70.2, 68.1, 66.4), half(65.3, 63.2, 61.1);
  const Pyramid pyramid(buildField(
      folder, Index3(141, 137, 133),
      [&](const glm::dvec3& p) {
        const glm::dvec3 inside = half - glm::abs(p - middle);
        return glm::clamp(std::min({inside.x, inside.y, inside.z}), -1.0, 1.0);
      },
      options));
  const IndexedMesh mesh = meshOfQuery(pyramid, sphereQuery(0.5));
  const MeshReport report = checkMesh(mesh.positions, mesh.triangles, {});
  EXPECT_TRUE(report.ok()) << report.summary();
  EXPECT_LE(report.triangles, 400);  // with seams more than 10,000
}

// More than one cube of bricks.
TEST(Simplify, CubesOfBricksFitEachOther) {
  for (unsigned seed = 0; seed < 4; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    RandomCase random(seed);
    const TemporaryFolder folder;
    BuildOptions options;
    options.brick_cells = std::int64_t{16} << (seed % 3);
    Index3 dims(random.uniform(10, 40), random.uniform(10, 40), random.uniform(10, 40));
    dims[static_cast<int>(seed % 3)] = random.uniform(260, 600);
    const double bend = random.real(3, 9);
    const Pyramid pyramid(buildField(
        folder, dims,
        [&](const glm::dvec3& p) {
          return std::sin(p.x / bend) * std::cos(p.y / bend) +
                 std::sin(p.y / bend) * std::cos(p.z / bend) +
                 std::sin(p.z / bend) * std::cos(p.x / bend);
        },
        options));
    const IndexedMesh finest = meshOfQuery(pyramid, sphereQuery(0)),
                      mesh = meshOfQuery(pyramid, sphereQuery(0.4));
    const MeshReport report =
        checkMesh(mesh.positions, mesh.triangles, indexOptions(pyramid.spec().voxels));
    ASSERT_TRUE(report.ok()) << report.summary();
    EXPECT_TRUE(crossingTriangles(mesh.positions, mesh.triangles).empty());
    EXPECT_LT(mesh.triangles.size(), finest.triangles.size() / 3);
    ASSERT_LE(greatestDistance(plainMesh(mesh), plainMesh(finest), dims), 0.4 + 1e-3);
    ASSERT_LE(greatestDistance(plainMesh(finest), plainMesh(mesh), dims), 0.4 + 1e-3);
  }
}

TEST(Simplify, LeavesNoTriangleWithoutArea) {
  for (unsigned seed = 0; seed < 60; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    RandomCase random(seed);
    const TemporaryFolder folder;
    const Pyramid pyramid(fewValues(folder, random, 8));
    const IndexedMesh mesh = meshOfQuery(pyramid, sphereQuery(random.real(0.05, 1)));
    const MeshReport report =
        checkMesh(mesh.positions, mesh.triangles, indexOptions(pyramid.spec().voxels));
    ASSERT_TRUE(report.ok()) << report.summary();
    // Nor one that single precision makes such.
    EXPECT_GT(report.smallest_area, 1e-9);
  }
}

TEST(Simplify, PiecesOfABrickStayApart) {
  std::size_t simplified = 0, finest = 0;
  for (unsigned seed = 0; seed < 24; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    RandomCase random(seed);
    const TemporaryFolder folder;
    const Pyramid pyramid(seed % 2 == 0 ? fewValues(folder, random, 32)
                                        : buildRandomPyramid(random, folder, 5));
    Query query = sphereQuery(random.real(0.1, 2));
    if (seed % 2 != 0) query.isovalue = random.real(20, 180);
    if (pyramid.layout().bricks(0) != Index3(1) || elementCount(pyramid.spec().voxels) > 6000)
      continue;
    const IndexedMesh mesh = meshOfQuery(pyramid, query);
    ASSERT_TRUE(crossingTriangles(mesh.positions, mesh.triangles).empty());
    simplified += mesh.triangles.size();
    query.simplify.reset();
    finest += meshOfQuery(pyramid, query).triangles.size();
  }
  EXPECT_GT(finest, 20'000u);
  EXPECT_LT(simplified, finest * 9 / 10);
}

// Whose distance is more than it is thick.
TEST(Simplify, BothSidesOfAWallStayApart) {
  const TemporaryFolder folder;
  BuildOptions options;
  options.brick_cells = 64;
  const Pyramid pyramid(buildField(
      folder, Index3(49),
      [](const glm::dvec3& p) { return 1.0 - std::abs(glm::length(p - 24.3) - 15); }, options));
  for (const double distance : {0.5, 1.0, 2.0, 4.0}) {
    const IndexedMesh mesh = meshOfQuery(pyramid, sphereQuery(distance));
    EXPECT_TRUE(crossingTriangles(mesh.positions, mesh.triangles).empty()) << distance;
    const MeshReport report = checkMesh(mesh.positions, mesh.triangles, {});
    EXPECT_TRUE(report.ok()) << report.summary();
    EXPECT_EQ(report.components, 2);
    EXPECT_EQ(report.euler, 4);
  }
}

// One number is one length, whatever the spacing: voxels are those of the least one.
TEST(Simplify, ADistanceInVoxelsIsOneOfTheLeastSpacing) {
  const TemporaryFolder folder;
  GridGeometry geometry;
  geometry.spacing = {0.4, 0.4, 3.1};
  const Index3 dims(49, 49, 13);
  const Pyramid pyramid(buildField(
      folder, dims,
      [](const glm::dvec3& p) {
        return 8 - glm::length((p - glm::dvec3(24, 24, 6)) * glm::dvec3(0.4, 0.4, 3.1));
      },
      {}, geometry));
  const IndexedMesh finest = meshOfQuery(pyramid, sphereQuery(0)),
                    mesh = meshOfQuery(pyramid, sphereQuery(1));
  const Index3 box(40);  // millimetres
  EXPECT_LE(greatestDistance(plainMesh(mesh), plainMesh(finest), box), 0.4 + 1e-3);
  EXPECT_LE(greatestDistance(plainMesh(finest), plainMesh(mesh), box), 0.4 + 1e-3);
  Query query = sphereQuery(0);
  query.simplify = SimplifyOptions{.distance = 0.4, .in_world = true};
  EXPECT_EQ(meshOfQuery(pyramid, query).triangles, mesh.triangles);
}

// A sphere of radius 40 voxels in bricks of 32 cells.
std::string sphere(const TemporaryFolder& folder, const GridGeometry& geometry = {}) {
  BuildOptions options;
  options.brick_cells = 32;
  return buildField(
      folder, Index3(97), [](const glm::dvec3& p) { return 40 - glm::length(p - 48.0); }, options,
      geometry);
}

TEST(Simplify, ASphereNeedsAFifthOfItsTriangles) {
  const TemporaryFolder folder;
  const Pyramid pyramid(sphere(folder));
  const std::size_t finest = meshOfQuery(pyramid, sphereQuery(0)).triangles.size();
  EXPECT_LT(meshOfQuery(pyramid, sphereQuery(0.25)).triangles.size(), finest / 5);
}

TEST(Simplify, ThreadsDoNotChangeAByte) {
  const TemporaryFolder folder;
  const Pyramid pyramid(sphere(folder));
  const auto hashWith = [&](int threads) {
    HashingSink sink;
    tbb::task_arena(threads).execute([&] { extractIsosurface(pyramid, sphereQuery(0.2), sink); });
    return sink.value();
  };
  EXPECT_EQ(hashWith(1), hashWith(4));
}

TEST(Simplify, ADistanceInTheWorldCountsThere) {
  for (const double spacing : {0.5, 1e-15, 1e15}) {
    const TemporaryFolder folder;
    GridGeometry geometry;
    geometry.spacing = glm::dvec3(spacing);
    const Pyramid pyramid(sphere(folder, geometry));
    Query query = sphereQuery(0.4);
    const std::size_t in_voxels = meshOfQuery(pyramid, query).triangles.size();
    query.simplify = SimplifyOptions{.distance = 0.4 * spacing, .in_world = true};
    const std::size_t in_world = meshOfQuery(pyramid, query).triangles.size();
    EXPECT_LT(in_world, in_voxels * 5 / 4);
    EXPECT_GT(in_world, in_voxels * 3 / 4);
  }
}

TEST(Simplify, DistancesThatAreNoneAreRefused) {
  const TemporaryFolder folder;
  const Pyramid pyramid(sphere(folder));
  for (const double distance : {0.0, -1.0, std::numeric_limits<double>::infinity()}) {
    Query query = sphereQuery(0);
    query.simplify = SimplifyOptions{distance};
    HashingSink sink;
    EXPECT_THROW(extractIsosurface(pyramid, query, sink), Error);
  }
}

TEST(Simplify, FindsTheDistanceForANumberOfTriangles) {
  const TemporaryFolder folder;
  const Pyramid pyramid(sphere(folder));
  const std::size_t finest = meshOfQuery(pyramid, sphereQuery(0)).triangles.size() / 3;
  Extractor extractor(pyramid);
  EXPECT_FALSE(findSimplification(extractor, sphereQuery(0), finest));
  for (const std::size_t most : {finest / 2, finest / 5}) {
    const auto found = findSimplification(extractor, sphereQuery(0), most);
    ASSERT_TRUE(found);
    const std::size_t count =
        meshOfQuery(pyramid, sphereQuery(found->distance)).triangles.size() / 3;
    EXPECT_LE(count, most);
    EXPECT_GT(count, most * 9 / 10);
  }
  EXPECT_THROW(findSimplification(extractor, sphereQuery(0), 3), Error);
}

// Flat faces need next to no distance, and with more of it there may be more triangles again.
TEST(Simplify, FindsTheLeastDistanceThatIsEnough) {
  const TemporaryFolder folder;
  const Pyramid pyramid(buildField(folder, Index3(41), [](const glm::dvec3& p) {
    const glm::dvec3 d = glm::abs(p - glm::dvec3(20.1, 19.7, 20.4));
    return 12.25 - std::max({d.x, d.y, d.z, (d.x + d.y + d.z) / 1.7});
  }));
  Extractor extractor(pyramid);
  const std::size_t finest = meshOfQuery(pyramid, sphereQuery(0)).triangles.size() / 3;
  for (const std::size_t most : {finest / 2, finest / 4, finest / 8}) {
    double least = 0;
    for (double distance = 1e-3; distance < 8 && least == 0; distance *= 2)
      if (meshOfQuery(pyramid, sphereQuery(distance)).triangles.size() / 3 <= most)
        least = distance;
    const auto found = findSimplification(extractor, sphereQuery(0), most);
    ASSERT_TRUE(found);
    EXPECT_LE(found->distance, 4 * least) << most << " triangles";
    EXPECT_LE(meshOfQuery(pyramid, sphereQuery(found->distance)).triangles.size() / 3, most);
  }
}

// The counts of a surface that is not there yet would find another distance.
TEST(Simplify, FindsTheDistanceForAProgressiveQueryToo) {
  const TemporaryFolder folder;
  const Pyramid pyramid(sphere(folder));
  const std::size_t most = meshOfQuery(pyramid, sphereQuery(0)).triangles.size() / 15;
  Query progressive = sphereQuery(0);
  progressive.is_progressive = true;
  Extractor first(pyramid);
  const auto found = findSimplification(first, progressive, most);
  ASSERT_TRUE(found);
  EXPECT_LE(meshOfQuery(pyramid, sphereQuery(found->distance)).triangles.size() / 3, most);
}

TEST(Simplify, SmallPiecesGoIfThatIsAsked) {
  // A ball, and single voxels: two inside of bricks, one between two. Each has a surface of one
  // voxel an axis, and its box a diagonal of the root of 3.
  const TemporaryFolder folder;
  BuildOptions build;
  build.brick_cells = 32;
  const auto field = [](const glm::dvec3& p) {
    for (const glm::dvec3& voxel :
         {glm::dvec3(3, 4, 5), glm::dvec3(90, 4, 70), glm::dvec3(32, 5, 5)})
      if (p == voxel) return 10.0;
    return std::clamp(20 - glm::length(p - 48.0), -10.0, 10.0);
  };
  for (const double spacing : {1.0, 0.25}) {
    GridGeometry geometry;
    geometry.spacing = glm::dvec3(spacing);
    const Pyramid pyramid(buildField(folder, Index3(97), field, build, geometry));
    const auto piecesAt = [&](double distance, bool drop_small) {
      Query query = sphereQuery(0);
      query.simplify = SimplifyOptions{distance * spacing, spacing != 1.0, drop_small};
      const IndexedMesh mesh = meshOfQuery(pyramid, query);
      EXPECT_TRUE(checkMesh(mesh.positions, mesh.triangles, {}).ok());
      return trianglesOfComponents(mesh).size();
    };
    EXPECT_EQ(piecesAt(1.8, false), 4u);
    EXPECT_EQ(piecesAt(1.7, true), 4u);
    EXPECT_EQ(piecesAt(1.8, true), 2u);
    EXPECT_EQ(piecesAt(0.5, true), 4u);
  }
}

}  // namespace
}  // namespace isobrick::test
