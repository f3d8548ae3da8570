// The extractor against analytic truth, and what must not change its result.
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <numbers>
#include <tuple>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/indexed_mesh.h"
#include "isobrick/extract/sinks/mesh_file_sink.h"
#include "isobrick/extract/sinks/vertex_numbering.h"
#include "isobrick/storage/pyramid_parts.h"
#include "tests/support/field_pyramid.h"
#include "tests/support/file_bytes.h"
#include "tests/support/mesh_checker.h"
#include "tests/support/ply_reader.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

IndexedMesh extractMesh(const Pyramid& pyramid, const Query& query) {
  IndexedMeshSink sink;
  extractIsosurface(pyramid, query, sink);
  return sink.takeMesh();
}

Query queryAt(double isovalue) {
  Query query;
  query.isovalue = isovalue;
  return query;
}

Query focusQuery(double isovalue, const glm::dvec3& center, double radius) {
  Query query = queryAt(isovalue);
  query.focus = FocusSphere{center, radius};
  return query;
}

Field sphere(const glm::dvec3& center, double radius) {
  return [=](const glm::dvec3& p) { return radius - glm::length(p - center); };
}

// Bumps without symmetry, as integers with many equal values.
double bumps(const glm::dvec3& p) {
  return std::round(100 + 30 * std::sin(0.31 * p.x + 0.11 * p.y) + 25 * std::sin(0.23 * p.y + 1) +
                    28 * std::cos(0.27 * p.z + 0.05 * p.x));
}

// The mesh without the order that bricks give it: triangles by position, rotated to begin with
// their least vertex.
using Corner = std::tuple<double, double, double>;
std::vector<std::array<Corner, 3>> sortedTriangles(const IndexedMesh& mesh) {
  std::vector<std::array<Corner, 3>> triangles;
  for (std::size_t t = 0; t < mesh.triangles.size(); t += 3) {
    std::array<Corner, 3> triangle;
    for (std::size_t i = 0; i < 3; ++i) {
      const glm::dvec3& p = mesh.positions[mesh.triangles[t + i]];
      triangle[i] = {p.x, p.y, p.z};
    }
    std::rotate(triangle.begin(), std::min_element(triangle.begin(), triangle.end()),
                triangle.end());
    triangles.push_back(triangle);
  }
  std::sort(triangles.begin(), triangles.end());
  return triangles;
}

TEST(Extract, LinearFieldsAreExactOnEveryLevelAndAcrossTransitions) {
  const TemporaryFolder folder;
  const glm::dvec3 slope(1.0, 0.5, 0.25);
  for (const Index3 dims : {Index3(33, 33, 33), Index3(23, 38, 11), Index3(6, 7, 50)}) {
    const Pyramid pyramid(
        buildField(folder, dims, [&](const glm::dvec3& p) { return glm::dot(slope, p); }));
    const double isovalue = 0.47 * glm::dot(slope, glm::dvec3(dims - Index3(1)));
    std::vector<Query> queries;
    for (int level = 0; level < pyramid.lattice().levels(); ++level) {
      queries.push_back(queryAt(isovalue));
      queries.back().uniform_level = level;
    }
    queries.push_back(focusQuery(isovalue, glm::dvec3(dims) * 0.4, 2));
    for (const Query& query : queries) {
      const IndexedMesh mesh = extractMesh(pyramid, query);
      ASSERT_TRUE(checkMesh(mesh.positions, mesh.triangles, indexOptions(dims)).ok());
      for (std::size_t v = 0; v < mesh.positions.size(); ++v) {
        // A float isovalue, and the margin of 1/4096 at the ends of an edge of up to 64 voxels.
        ASSERT_NEAR(glm::dot(slope, mesh.positions[v]), isovalue, 64.0 / 4096);
        ASSERT_GT(glm::dot(glm::dvec3(mesh.normals[v]), -glm::normalize(slope)), 1 - 1e-5);
      }
    }
  }
}

TEST(Extract, AreaAndVolumeOfASphereConvergeWithTheSquareOfTheSpacing) {
  const TemporaryFolder folder;
  std::vector<double> area_errors, volume_errors;
  for (const std::int64_t cells : {16, 32, 64, 128}) {
    const double radius = 0.37 * static_cast<double>(cells);
    const glm::dvec3 center(0.5 * static_cast<double>(cells) + 0.1);
    const Pyramid pyramid(buildField(folder, Index3(cells + 1), sphere(center, radius)));
    const IndexedMesh mesh = extractMesh(pyramid, queryAt(0));
    const MeshReport report =
        checkMesh(mesh.positions, mesh.triangles, indexOptions(Index3(cells + 1)));
    ASSERT_TRUE(report.ok()) << report.summary();
    ASSERT_EQ(report.border_edges, 0);
    ASSERT_EQ(report.genus, 0);
    const double true_area = 4 * std::numbers::pi * radius * radius;
    area_errors.push_back(std::abs(report.area / true_area - 1));
    volume_errors.push_back(std::abs(report.volume / (true_area * radius / 3) - 1));
    for (const glm::dvec3& p : mesh.positions)
      ASSERT_LT(std::abs(glm::length(p - center) - radius), 0.5 / radius);
  }
  for (std::size_t i = 0; i + 1 < area_errors.size(); ++i) {
    std::printf("sphere, %d cells across: area error %.2e, volume error %.2e\n", 16 << i,
                area_errors[i], volume_errors[i]);
    EXPECT_NEAR(area_errors[i] / area_errors[i + 1], 4, 0.7);
    EXPECT_NEAR(volume_errors[i] / volume_errors[i + 1], 4, 0.7);
  }
}

TEST(Extract, TorusHasGenusOneAlsoAcrossLevels) {
  const TemporaryFolder folder;
  const Index3 dims(65);
  const glm::dvec3 center(32.3, 31.8, 32.1);
  const Pyramid pyramid(buildField(folder, dims, [&](const glm::dvec3& p) {
    const glm::dvec3 d = p - center;
    return 8 - std::hypot(std::hypot(d.x, d.y) - 18, d.z);
  }));
  for (const Query& query : {queryAt(0), focusQuery(0, {50, 32, 32}, 6)}) {
    const IndexedMesh mesh = extractMesh(pyramid, query);
    const MeshReport report = checkMesh(mesh.positions, mesh.triangles, indexOptions(dims));
    ASSERT_TRUE(report.ok()) << report.summary();
    EXPECT_EQ(report.genus, 1);
    EXPECT_GT(report.volume, 0);
  }
}

// One period of a gyroid, its opposite sides glued: a closed surface in the 3-torus with Euler
// characteristic -8 (genus 3 for each of the two primitive cells of the cubic period).
TEST(Extract, GyroidHasTheGenusOfItsPeriod) {
  const TemporaryFolder folder;
  constexpr std::int64_t kPeriod = 32;
  const Pyramid pyramid(buildField(folder, Index3(kPeriod + 1), [](const glm::dvec3& p) {
    // Whole indices modulo the period, so that opposite sides have the same bits.
    const auto angle = [](double x) {
      return 2 * std::numbers::pi * (std::fmod(x, static_cast<double>(kPeriod)) + 0.21) / kPeriod;
    };
    const double x = angle(p.x), y = angle(p.y), z = angle(p.z);
    return std::sin(x) * std::cos(y) + std::sin(y) * std::cos(z) + std::sin(z) * std::cos(x);
  }));
  const IndexedMesh mesh = extractMesh(pyramid, queryAt(0.05));
  ASSERT_TRUE(checkMesh(mesh.positions, mesh.triangles, indexOptions(Index3(kPeriod + 1))).ok());
  std::map<Corner, std::size_t> glued;
  std::vector<std::size_t> vertex;
  for (const glm::dvec3& p : mesh.positions) {
    const auto wrap = [](double x) { return x == static_cast<double>(kPeriod) ? 0.0 : x; };
    vertex.push_back(
        glued.emplace(Corner{wrap(p.x), wrap(p.y), wrap(p.z)}, glued.size()).first->second);
  }
  std::map<std::pair<std::size_t, std::size_t>, int> uses;
  for (std::size_t t = 0; t < mesh.triangles.size(); t += 3)
    for (std::size_t i = 0; i < 3; ++i) {
      const std::size_t a = vertex[mesh.triangles[t + i]];
      const std::size_t b = vertex[mesh.triangles[t + (i + 1) % 3]];
      ++uses[std::minmax(a, b)];
    }
  for (const auto& [edge, count] : uses) ASSERT_EQ(count, 2);
  const auto euler = static_cast<std::int64_t>(glued.size()) -
                     static_cast<std::int64_t>(uses.size()) +
                     static_cast<std::int64_t>(mesh.triangles.size() / 3);
  EXPECT_EQ(euler, -8);
}

TEST(Extract, FilesAreTheSameForAnyNumberOfThreadsAndAnyBudget) {
  const TemporaryFolder folder;
  BuildOptions options;
  options.brick_cells = 16;
  Query query = focusQuery(100, {30, 40, 20}, 15);
  query.curvature_tolerance = 0.01;
  std::vector<std::string> files;
  for (const format::Codec codec : {format::Codec::kStored, format::Codec::kLz4}) {
    options.codec = codec;
    const std::string path = buildField<std::uint8_t>(folder, {70, 65, 81}, bumps, options);
    for (const std::size_t threads : {1, 2, 8})
      for (const std::uint64_t budget : {Pyramid::kDefaultBudgetBytes, std::uint64_t{1}}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        const Pyramid pyramid(path, budget);
        const auto sink = makeMeshFileSink(folder.file("mesh.ply"));
        extractIsosurface(pyramid, query, *sink);
        files.push_back(readBytes(folder.file("mesh.ply")));
        if (budget == 1) {
          EXPECT_GT(pyramid.parts().counters().parts_released, 0u);
          EXPECT_LE(pyramid.parts().heldBytes(), budget);
        }
      }
  }
  ASSERT_GT(files[0].size(), 10000u);
  for (const std::string& file : files) EXPECT_TRUE(file == files[0]);
}

TEST(Extract, TheSurfaceIsTheSameForAnyBrickSize) {
  const TemporaryFolder folder;
  for (const Index3 dims : {Index3(64, 65, 63), Index3(37, 41, 90), Index3(2, 3, 70)}) {
    std::vector<std::vector<std::array<Corner, 3>>> meshes;
    for (const std::int64_t brick : {4, 8, 16, 32, 64, 128}) {
      BuildOptions options;
      options.brick_cells = brick;
      options.tile_cells = std::min<std::int64_t>(brick, 8);
      const Pyramid pyramid(buildField<std::int16_t>(folder, dims, bumps, options));
      for (const Query& query : {queryAt(101), focusQuery(101, {11, 20, 30}, 7)}) {
        const IndexedMesh mesh = extractMesh(pyramid, query);
        ASSERT_TRUE(checkMesh(mesh.positions, mesh.triangles, indexOptions(dims)).ok());
        meshes.push_back(sortedTriangles(mesh));
      }
    }
    ASSERT_FALSE(meshes[0].empty());
    for (std::size_t i = 2; i < meshes.size(); ++i) EXPECT_TRUE(meshes[i] == meshes[i % 2]);
  }
}

TEST(Extract, ObliqueFlippedAndAnisotropicVolumesKeepOrientationAndNormals) {
  const TemporaryFolder folder;
  const Index3 dims(40, 36, 44);
  GridGeometry geometry;
  geometry.spacing = {0.5, 1.25, 2};
  geometry.origin = {-10, 20, 5};
  const double c = std::cos(0.4), s = std::sin(0.4);
  for (const double flip : {1.0, -1.0}) {
    geometry.direction =
        glm::dmat3(glm::dvec3(c, s, 0), glm::dvec3(-s, c, 0), glm::dvec3(0, 0, flip));
    const glm::dvec3 center = geometry.indexToWorld({19, 17, 21});
    const Pyramid pyramid(buildField(
        folder, dims,
        [&](const glm::dvec3& p) { return 7 - glm::length(geometry.indexToWorld(p) - center); }, {},
        geometry));
    for (const Query& query : {queryAt(0), focusQuery(0, {19, 10, 21}, 4)}) {
      const IndexedMesh mesh = extractMesh(pyramid, query);
      const MeshReport report =
          checkMesh(mesh.positions, mesh.triangles, volumeOptions(geometry, dims));
      ASSERT_TRUE(report.ok()) << report.summary();
      // Coarser levels average the surface inwards, but never turn it inside out.
      const double true_volume = 4.0 / 3 * std::numbers::pi * 343;
      EXPECT_NEAR(report.volume, true_volume, (query.focus ? 0.3 : 0.04) * true_volume);
      for (std::size_t v = 0; v < mesh.positions.size(); ++v) {
        const glm::dvec3 outward = glm::normalize(mesh.positions[v] - center);
        ASSERT_GT(glm::dot(glm::dvec3(mesh.normals[v]), outward), query.focus ? 0.8 : 0.95);
      }
    }
  }
}

// One voxel that means "no value", as some formats have it, and the normals elsewhere.
TEST(Extract, NormalsKeepTheirDirectionBesideAHugeValue) {
  const TemporaryFolder folder;
  for (const bool is_oblique : {false, true}) {
    GridGeometry geometry;
    if (is_oblique)
      geometry.direction =
          glm::dmat3(glm::dvec3(0.8, 0.6, 0), glm::dvec3(-0.6, 0.8, 0), glm::dvec3(0, 0, 1));
    const glm::dvec3 centre(10.2, 9.7, 10.4);
    const std::string path = buildField<float>(
        folder, {40, 21, 21},
        [&](const glm::dvec3& p) {
          return p == glm::dvec3(39, 20, 20) ? 9.96921e36 : -glm::length(p - centre);
        },
        {}, geometry);
    IndexedMeshSink sink;
    const Pyramid pyramid(path);
    extractIsosurface(pyramid, queryAt(-6.5), sink);
    int checked = 0;
    for (std::size_t v = 0; v < sink.mesh().positions.size(); ++v) {
      const glm::dvec3 out = sink.mesh().positions[v] - geometry.indexToWorld(centre);
      if (glm::length(out) > 9) continue;
      ++checked;
      ASSERT_GT(glm::dot(glm::normalize(out), glm::dvec3(sink.mesh().normals[v])), 0.99);
    }
    EXPECT_GT(checked, 500);
  }
}

TEST(Extract, HalvesOfABoxMakeTheWhole) {
  const TemporaryFolder folder;
  BuildOptions options;
  options.brick_cells = 8;
  const Pyramid pyramid(buildField<std::uint8_t>(folder, {33, 33, 33}, bumps, options));
  for (Query query : {queryAt(97), focusQuery(97, {16, 16, 16}, 32)}) {
    const auto whole = sortedTriangles(extractMesh(pyramid, query));
    query.box = QueryBox{{0, 0, 0}, {13, 32, 32}};
    auto parts = sortedTriangles(extractMesh(pyramid, query));
    ASSERT_GT(parts.size(), 0u);
    ASSERT_LT(parts.size(), whole.size());
    query.box = QueryBox{{13, 0, 0}, {32, 32, 32}};
    const auto other = sortedTriangles(extractMesh(pyramid, query));
    parts.insert(parts.end(), other.begin(), other.end());
    std::sort(parts.begin(), parts.end());
    EXPECT_TRUE(parts == whole);
  }
}

TEST(Extract, SinksAgreeAndFilesHoldTheMesh) {
  const TemporaryFolder folder;
  const Pyramid pyramid(buildField<std::uint8_t>(folder, {50, 40, 45}, bumps));
  const Query query = focusQuery(103, {20, 20, 20}, 5);
  CountingSink counter;
  const ExtractionReport report = extractIsosurface(pyramid, query, counter);
  const IndexedMesh mesh = extractMesh(pyramid, query);
  EXPECT_EQ(report.triangles, counter.triangles());
  EXPECT_EQ(mesh.triangles.size() / 3, counter.triangles());
  EXPECT_EQ(mesh.positions.size(), counter.vertices());
  EXPECT_GT(report.levels.size(), 1u);

  const auto ply = makeMeshFileSink(folder.file("mesh.ply"));
  extractIsosurface(pyramid, query, *ply);
  EXPECT_EQ(ply->vertices(), counter.vertices());
  const auto read = readPly(folder.file("mesh.ply"));
  ASSERT_EQ(read.positions.size(), mesh.positions.size());
  EXPECT_TRUE(read.triangles == mesh.triangles);
  for (std::size_t v = 0; v < mesh.positions.size(); ++v)
    ASSERT_EQ(glm::vec3(read.positions[v]), glm::vec3(mesh.positions[v]));

  const auto stl = makeMeshFileSink(folder.file("mesh.stl"));
  extractIsosurface(pyramid, query, *stl);
  EXPECT_EQ(readBytes(folder.file("mesh.stl")).size(), 84 + 50 * counter.triangles());
}

// Far from the origin, floats no longer separate crossings 1/4096 of an edge apart.
TEST(Extract, PlyTurnsToDoublesWhereFloatsWouldCollapse) {
  const TemporaryFolder folder;
  GridGeometry far;
  far.origin = {1e6, -2e6, 3e6};
  const Pyramid pyramid(buildField<std::uint8_t>(folder, {20, 20, 20}, bumps, BuildOptions{}, far));
  const auto sink = makeMeshFileSink(folder.file("far.ply"));
  extractIsosurface(pyramid, queryAt(100), *sink);
  EXPECT_NE(readBytes(folder.file("far.ply")).find("property double x"), std::string::npos);
  const auto mesh = readPly(folder.file("far.ply"));
  MeshCheckOptions options = volumeOptions(far, Index3(20));
  EXPECT_TRUE(checkMesh(mesh.positions, mesh.triangles, options).ok());
}

TEST(Extract, RefusesQueriesThatMakeNoSense) {
  const TemporaryFolder folder;
  BuildOptions options;
  options.with_curvature = false;
  const Pyramid pyramid(buildField<std::uint8_t>(folder, {9, 9, 9}, bumps, options));
  const auto refuses = [&](const Query& query) {
    CountingSink sink;
    EXPECT_THROW(extractIsosurface(pyramid, query, sink), Error);
  };
  refuses(queryAt(std::nan("")));
  Query query = queryAt(1);
  query.uniform_level = pyramid.lattice().levels();
  refuses(query);
  query.uniform_level = 1;
  query.focus = FocusSphere{};
  refuses(query);
  refuses(focusQuery(1, {0, 0, 0}, -1));
  refuses(focusQuery(1, {0, -1e16, 0}, 1.7e16));  // too far for exact distances
  query = queryAt(1);
  query.curvature_tolerance = 0.1;  // the file has none
  refuses(query);
  query = queryAt(1);
  query.box = QueryBox{{1, 1, 1}, {2, 1, 2}};
  refuses(query);
  EXPECT_THROW(makeMeshFileSink(folder.file("mesh.xyz")), Error);
}

// There is no level 1 that could be near its only cell.
TEST(Extract, ATolerantQueryKeepsAVolumeOfOneCell) {
  const TemporaryFolder folder;
  const auto sum = [](const glm::dvec3& p) { return p.x + p.y + p.z; };
  const Pyramid pyramid(buildField<float>(folder, {2, 2, 2}, sum));
  ASSERT_EQ(pyramid.lattice().levels(), 1);
  for (const double tolerance : {0.0, 0.1, 10.0}) {
    Query query = queryAt(1.5);
    query.curvature_tolerance = tolerance;
    IndexedMeshSink sink;
    EXPECT_GT(extractIsosurface(pyramid, query, sink).triangles, 0) << tolerance;
  }
}

TEST(Extract, CancelledAndFailedRunsLeaveNoFile) {
  const TemporaryFolder folder;
  const std::string path = buildField<std::uint8_t>(folder, {50, 50, 50}, bumps);
  {
    const Pyramid pyramid(path);
    CancelFlag cancel;
    cancel.request();
    Query query = queryAt(100);
    query.cancel = &cancel;
    const auto sink = makeMeshFileSink(folder.file("mesh.ply"));
    EXPECT_THROW(extractIsosurface(pyramid, query, *sink), Cancelled);
  }
  // One byte in the middle of the samples of the only brick of level 0.
  std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
  file.seekp(60000);
  const char old = static_cast<char>(file.peek());
  file.seekp(60000);
  file.put(static_cast<char>(old ^ 1));
  file.close();
  {
    const Pyramid pyramid(path);
    const auto sink = makeMeshFileSink(folder.file("mesh.ply"));
    try {
      extractIsosurface(pyramid, queryAt(100), *sink);
      FAIL() << "a damaged brick was used";
    } catch (const Error& error) {
      EXPECT_NE(std::string(error.what()).find("brick (0,0,0) of level 0"), std::string::npos)
          << error.what();
    }
  }
  EXPECT_FALSE(std::filesystem::exists(folder.file("mesh.ply")));
  EXPECT_FALSE(std::filesystem::exists(folder.file("mesh.ply.isobrick.partial")));
}

}  // namespace
}  // namespace isobrick::test
