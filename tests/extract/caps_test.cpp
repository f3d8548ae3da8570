// Query::cap: surfaces that are closed where they leave the volume or a box, against solids of
// known volume and area. The property test compares random ones with the reference mesher.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <glm/geometric.hpp>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>
#include <sstream>
#include <string>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/one_pass_surface.h"
#include "isobrick/extract/shares/mesh_share.h"
#include "isobrick/extract/sinks/indexed_mesh.h"
#include "isobrick/extract/sinks/mesh_file_sink.h"
#include "isobrick/extract/sinks/surface_components.h"
#include "tests/extract/random_case.h"
#include "tests/support/array_source.h"
#include "tests/support/crossing_triangles.h"
#include "tests/support/field_pyramid.h"
#include "tests/support/file_bytes.h"
#include "tests/support/mesh_checker.h"
#include "tests/support/repetitions.h"

namespace isobrick::test {
namespace {

Query cappedQuery(double isovalue = 0) {
  Query query;
  query.isovalue = isovalue;
  query.cap = true;
  return query;
}

class CapsTest : public testing::Test {
 protected:
  std::shared_ptr<const Pyramid> open(const Index3& dims, const Field& field,
                                      std::int64_t brick_cells = 16,
                                      const GridGeometry& geometry = {}) {
    BuildOptions options;
    options.brick_cells = brick_cells;
    options.tile_cells = 4;
    return std::make_shared<const Pyramid>(buildField(folder_, dims, field, options, geometry));
  }
  // Of a mesh that is closed, oriented and does not cross itself.
  static MeshReport solidOf(const IndexedMesh& mesh) {
    const MeshReport report = checkMesh(mesh.positions, mesh.triangles);
    EXPECT_TRUE(report.ok()) << report.summary();
    EXPECT_TRUE(crossingTriangles(mesh.positions, mesh.triangles).empty());
    EXPECT_EQ(mesh.triangle_caps.size(), mesh.triangles.size() / 3);
    return report;
  }
  static IndexedMesh meshOf(const Pyramid& pyramid, const Query& query,
                            ExtractionReport* report = nullptr) {
    IndexedMeshSink sink;
    const ExtractionReport made = extractIsosurface(pyramid, query, sink);
    if (report != nullptr) *report = made;
    return sink.takeMesh();
  }
  static double capArea(const IndexedMesh& mesh) {
    double area = 0;
    for (std::size_t t = 0; t < mesh.triangle_caps.size(); ++t) {
      if (mesh.triangle_caps[t] == 0) continue;
      const auto at = [&](std::size_t c) { return mesh.positions[mesh.triangles[3 * t + c]]; };
      area += glm::length(glm::cross(at(1) - at(0), at(2) - at(0))) / 2;
    }
    return area;
  }

  const TemporaryFolder folder_;
};

TEST_F(CapsTest, AVolumeThatIsInsideAsAWholeIsItsBox) {
  for (const Index3& dims :
       {Index3(2), Index3(2, 2, 9), Index3(5, 7, 3), Index3(33, 17, 40), Index3(18, 2, 66)}) {
    SCOPED_TRACE(dims.x);
    const auto pyramid = open(dims, [](const glm::dvec3& p) { return 5 + p.x; });
    const glm::dvec3 e(dims - Index3(1));
    for (int level = 0; level < pyramid->lattice().levels(); ++level) {
      Query query = cappedQuery(1);
      query.uniform_level = level;
      ExtractionReport report;
      const IndexedMesh mesh = meshOf(*pyramid, query, &report);
      const MeshReport solid = solidOf(mesh);
      EXPECT_NEAR(solid.volume, e.x * e.y * e.z, 1e-6);
      EXPECT_NEAR(solid.area, 2 * (e.x * e.y + e.y * e.z + e.z * e.x), 1e-9 * solid.area);
      EXPECT_EQ(solid.euler, 2);
      EXPECT_EQ(report.levels[0].cap_triangles, report.triangles);
      const Index3 c = pyramid->lattice().cells(level);
      EXPECT_EQ(report.triangles,
                static_cast<std::uint64_t>(4 * (c.x * c.y + c.y * c.z + c.z * c.x)));
      const Index3 inner = glm::max(c - Index3(2), Index3(0));
      EXPECT_EQ(report.levels[0].cells,
                static_cast<std::uint64_t>(elementCount(c) - elementCount(inner)));
      query.inside = InsideOf::kBelow;
      EXPECT_TRUE(meshOf(*pyramid, query).triangles.empty());
      // No voxel of the type is as great; all of it is below.
      query.isovalue = 1e30;
      EXPECT_NEAR(solidOf(meshOf(*pyramid, query)).volume, e.x * e.y * e.z, 1e-6);
    }
    EXPECT_TRUE(meshOf(*pyramid, cappedQuery(1000)).triangles.empty());
  }
}

// A type whose greatest voxel is below the isovalue.
TEST_F(CapsTest, ATypeThatIsBelowAsAWholeIsABox) {
  const Pyramid pyramid(
      buildField<std::uint8_t>(folder_, Index3(20), [](const glm::dvec3& p) { return p.x; }));
  Query query = cappedQuery(300);
  query.inside = InsideOf::kBelow;
  EXPECT_NEAR(solidOf(meshOf(pyramid, query)).volume, 19.0 * 19.0 * 19.0, 1e-6);
}

TEST_F(CapsTest, BallsCutByAFaceAnEdgeAndACorner) {
  constexpr double kRadius = 14.3, kVoxels = 40;
  const Index3 dims(40);
  for (const glm::dvec3& center : {glm::dvec3(0, 20, 20), glm::dvec3(kVoxels - 1, 20, 20),
                                   glm::dvec3(20, 0, kVoxels - 1), glm::dvec3(0), glm::dvec3(39)}) {
    int cuts = 0;
    for (int axis = 0; axis < 3; ++axis) cuts += center[axis] == 20 ? 0 : 1;
    SCOPED_TRACE(cuts);
    const auto pyramid =
        open(dims, [&](const glm::dvec3& p) { return kRadius - glm::distance(p, center); });
    const IndexedMesh mesh = meshOf(*pyramid, cappedQuery());
    const MeshReport solid = solidOf(mesh);
    const double part = std::exp2(-cuts), r2 = kRadius * kRadius;
    const double ball = 4 * std::numbers::pi / 3 * r2 * kRadius * part;
    EXPECT_NEAR(solid.volume, ball, 0.005 * ball);
    const double disc = cuts * std::numbers::pi * r2 * part * 2;
    EXPECT_NEAR(capArea(mesh), disc, 0.005 * disc);
    EXPECT_NEAR(solid.area, disc + 4 * std::numbers::pi * r2 * part, 0.005 * solid.area);
    EXPECT_EQ(solid.euler, 2);
  }
}

TEST_F(CapsTest, ASlabIsABoxToTheLastDigit) {
  const auto pyramid =
      open({24, 30, 21}, [](const glm::dvec3& p) { return 4.25 - std::abs(p.x - 11.5); });
  const IndexedMesh mesh = meshOf(*pyramid, cappedQuery());
  EXPECT_NEAR(solidOf(mesh).volume, 8.5 * 29 * 20, 1e-6);
  EXPECT_NEAR(capArea(mesh), 2 * 8.5 * (29 + 20), 1e-6);
}

TEST_F(CapsTest, SolidsWithLevelsAreTheSameSolids) {
  // Linear, so exact on every level; last cells of most levels are thin.
  const Index3 dims(51, 38, 46);
  const glm::dvec3 normal = glm::normalize(glm::dvec3(1, 0.6, -0.4));
  const auto pyramid = open(
      dims, [&](const glm::dvec3& p) { return 20 - glm::dot(p, normal); }, 8);
  const glm::dvec3 e(dims - Index3(1));
  const double volume = solidOf(meshOf(*pyramid, cappedQuery())).volume;
  double below = 0;
  for (const InsideOf inside : {InsideOf::kAbove, InsideOf::kBelow})
    for (const glm::dvec3& focus :
         {glm::dvec3(0), e, glm::dvec3(0, e.y, 20), glm::dvec3(25, 0, 0), e / 2.0}) {
      Query query = cappedQuery();
      query.inside = inside;
      query.focus = FocusSphere{focus, 3};
      ExtractionReport report;
      const MeshReport solid = solidOf(meshOf(*pyramid, query, &report));
      EXPECT_GE(report.levels.size(), 3u);
      if (inside == InsideOf::kBelow) below = solid.volume;
      EXPECT_NEAR(inside == InsideOf::kAbove ? solid.volume : e.x * e.y * e.z - solid.volume,
                  volume, 0.5);
    }
  EXPECT_NEAR(volume + below, e.x * e.y * e.z, 0.5);
}

TEST_F(CapsTest, FlippedObliqueAndAnisotropicVolumesAreSolidsToo) {
  GridGeometry geometry;
  geometry.spacing = {0.5, 2, 1.25};
  geometry.origin = {10, -20, 30};
  for (const bool flips : {false, true}) {
    geometry.direction = glm::dmat3(0.6, 0.8, 0, -0.8, 0.6, 0, 0, 0, flips ? -1 : 1);
    const auto pyramid = open(
        Index3(20), [](const glm::dvec3& p) { return 6.5 - p.x; }, 16, geometry);
    for (const InsideOf inside : {InsideOf::kAbove, InsideOf::kBelow}) {
      Query query = cappedQuery();
      query.inside = inside;
      const IndexedMesh mesh = meshOf(*pyramid, query);
      const MeshReport solid = checkMesh(mesh.positions, mesh.triangles);
      EXPECT_TRUE(solid.ok()) << solid.summary();
      const double length = inside == InsideOf::kAbove ? 6.5 : 12.5;
      EXPECT_NEAR(solid.volume, length * 19 * 19 * 1.25, 1e-3);
      // All normals look away from the middle of the box.
      glm::dvec3 middle(0);
      for (const glm::dvec3& p : mesh.positions) middle += p;
      middle /= static_cast<double>(mesh.positions.size());
      for (std::size_t v = 0; v < mesh.positions.size(); ++v)
        ASSERT_GT(glm::dot(glm::dvec3(mesh.normals[v]), mesh.positions[v] - middle), 0);
    }
  }
}

TEST_F(CapsTest, ABoxCutsASolidOutOfASolid) {
  const auto pyramid =
      open(Index3(60), [](const glm::dvec3& p) { return 25 - glm::distance(p, glm::dvec3(30)); });
  Query query = cappedQuery();
  // Within the ball, and between voxels: to the voxels around.
  query.box = QueryBox{{20.5, 22, 25}, {31, 40.2, 33}};
  EXPECT_NEAR(solidOf(meshOf(*pyramid, query)).volume, 11.0 * 19 * 8, 1e-6);
  // Half a ball.
  query.box = QueryBox{{30, -5, -5}, {80, 80, 80}};
  const double half = 2 * std::numbers::pi / 3 * 25 * 25 * 25;
  EXPECT_NEAR(solidOf(meshOf(*pyramid, query)).volume, half, 0.005 * half);
  // With coarse leaves at its border it grows.
  query.focus = FocusSphere{{40, 30, 30}, 2};
  ExtractionReport report;
  const MeshReport solid = solidOf(meshOf(*pyramid, query, &report));
  EXPECT_GE(report.levels.size(), 2u);
  EXPECT_GT(solid.volume, 0.98 * half);
  EXPECT_EQ(solid.euler, 2);
  // Beside the ball there is nothing.
  query.box = QueryBox{{0, 0, 0}, {4, 4, 4}};
  query.focus.reset();
  EXPECT_TRUE(meshOf(*pyramid, query).triangles.empty());
}

TEST_F(CapsTest, SimplifiedSolidsStayClosed) {
  for (int seed = 0; seed < repetitions(60); ++seed) {
    SCOPED_TRACE(seed);
    RandomCase random(static_cast<std::uint32_t>(seed));
    const TemporaryFolder folder;
    const Pyramid pyramid(buildRandomPyramid(random, folder, 2));
    Query query = randomQuery(random, pyramid);
    query.cap = true;
    const IndexedMesh finest = meshOf(pyramid, query);
    query.simplify = SimplifyOptions{random.real(0.1, 1.2)};
    ExtractionReport report;
    const IndexedMesh mesh = meshOf(pyramid, query, &report);
    const MeshReport solid = solidOf(mesh);
    EXPECT_LE(mesh.triangles.size(), finest.triangles.size());
    const double volume = checkMesh(finest.positions, finest.triangles).volume;
    EXPECT_NEAR(solid.volume, volume,
                1 + query.simplify->distance * checkMesh(finest.positions, finest.triangles).area);
    std::uint64_t caps = 0;
    for (const LevelCounts& counts : report.levels) caps += counts.cap_triangles;
    EXPECT_EQ(caps, static_cast<std::uint64_t>(std::ranges::count(mesh.triangle_caps, 1)));
    if (testing::Test::HasFailure()) return;
  }
}

TEST_F(CapsTest, AFlatBoxKeepsItsCornersWhenItIsSimplified) {
  const auto pyramid = open(
      Index3(33), [](const glm::dvec3&) { return 1.0; }, 32);
  Query query = cappedQuery();
  query.simplify = SimplifyOptions{0.25};
  const IndexedMesh mesh = meshOf(*pyramid, query);
  EXPECT_NEAR(solidOf(mesh).volume, 32.0 * 32 * 32, 1e-6);
  EXPECT_LT(mesh.triangles.size() / 3, 200u);
}

TEST_F(CapsTest, SimplifiedCapsStayInTheirPlanes) {
  const auto pyramid =
      open(Index3(60), [](const glm::dvec3& p) { return 33 - glm::distance(p, glm::dvec3(30)); });
  Query query = cappedQuery();
  query.simplify = SimplifyOptions{0.5};
  const IndexedMesh mesh = meshOf(*pyramid, query);
  solidOf(mesh);
  double area = 0;
  for (std::size_t t = 0; t < mesh.triangle_caps.size(); ++t) {
    if (mesh.triangle_caps[t] == 0) continue;
    const auto at = [&](std::size_t c) { return mesh.positions[mesh.triangles[3 * t + c]]; };
    int planes = 0;
    for (int axis = 0; axis < 3; ++axis)
      for (const double plane : {0.0, 59.0})
        planes += at(0)[axis] == plane && at(1)[axis] == plane && at(2)[axis] == plane;
    EXPECT_EQ(planes, 1) << t;
    area += glm::length(glm::cross(at(1) - at(0), at(2) - at(0))) / 2;
  }
  query.simplify.reset();
  EXPECT_NEAR(area, capArea(meshOf(*pyramid, query)), 0.03 * area);
}

TEST_F(CapsTest, PiecesHaveTheirVolumes) {
  // Two bars from border to border.
  const auto pyramid = open(Index3(40), [](const glm::dvec3& p) {
    return std::max(5.0 - glm::length(glm::dvec2(p.x - 10, p.y - 10)),
                    3.0 - glm::length(glm::dvec2(p.x - 28, p.y - 28)));
  });
  Query query = cappedQuery();
  ComponentFinder finder(query);
  extractIsosurface(*pyramid, query, finder);
  const SurfaceComponents components = finder.take();
  ASSERT_EQ(components.list().size(), 2u);
  for (const SurfaceComponent& one : components.list()) {
    const double radius = &one == &components.list()[0] ? 5 : 3;
    const double volume = std::numbers::pi * radius * radius * 39;
    ASSERT_TRUE(one.volume && one.enclosed);
    EXPECT_NEAR(*one.volume, volume, 0.03 * volume);
    EXPECT_EQ(*one.volume, *one.enclosed);
  }
  IndexedMeshSink kept;
  ComponentFilter filter(components, 1, kept);
  extractIsosurface(*pyramid, query, filter);
  EXPECT_NEAR(solidOf(kept.mesh()).volume, *components.list()[0].volume, 1e-6);
  EXPECT_NEAR(capArea(kept.mesh()), 2 * 25 * std::numbers::pi, 2);
}

// Into memory, of a volume without a pyramid, and in shares it is the same mesh, in all formats.
TEST_F(CapsTest, IsTheSameMeshOnAllWays) {
  const Index3 dims(37, 30, 41);
  std::vector<float> voxels;
  for (std::int64_t i = 0; i < elementCount(dims); ++i)
    voxels.push_back(static_cast<float>(std::sin(0.31 * static_cast<double>(i % dims.x)) +
                                        std::cos(0.23 * static_cast<double>(i / dims.x))));
  ArraySource<float> source(dims, voxels);
  BuildOptions options;
  buildPyramid(source, folder_.file("waves.isb"), options);
  const Pyramid pyramid(folder_.file("waves.isb"));
  for (const bool has_box : {false, true}) {
    Query query = cappedQuery(0.1);
    if (has_box) query.box = QueryBox{{3.5, -1, 7}, {20, 22.2, 33}};
    const IndexedMesh mesh = meshOf(pyramid, query);
    const MeshReport solid = solidOf(mesh);
    EXPECT_GT(solid.volume, 0);
    SurfaceMesh in_memory;
    extractIsosurface(pyramid, query, in_memory);
    EXPECT_TRUE(std::ranges::equal(in_memory.triangles(), mesh.triangles));
    std::uint64_t caps = 0;
    for (const SurfaceMesh::Part& part : in_memory.parts()) caps += part.caps;
    EXPECT_EQ(caps, static_cast<std::uint64_t>(std::ranges::count(mesh.triangle_caps, 1)));

    for (const std::string ending : {".ply", ".stl", ".obj", ".glb", ".vtp"}) {
      SCOPED_TRACE(ending);
      const auto fileOf = [&](const std::string& stem, const auto& extract) {
        const auto sink = makeMeshFileSink(folder_.file(stem + ending), {});
        extract(*sink);
        return readBytes(folder_.file(stem + ending));
      };
      const std::string whole =
          fileOf("whole", [&](TriangleSink& sink) { extractIsosurface(pyramid, query, sink); });
      Extractor extractor(pyramid);
      const ExtractionPlan plan = extractor.plan(query);
      std::vector<std::string> shares;
      for (std::uint32_t number = 1; number <= 3; ++number) {
        shares.push_back(folder_.file(std::to_string(number) + ".isbm"));
        const NumberRun run = bricksOf(plan, {number, 3});
        const auto share = makeMeshShareSink(shares.back(), pyramid, plan, {number, 3});
        extractor.execute(plan, run.first, run.count, *share);
      }
      EXPECT_TRUE(fileOf("merged", [&](TriangleSink& sink) { mergeMeshShares(shares, sink); }) ==
                  whole);
    }
  }
}

// The numbers of triangles of a .glb by material.
std::map<int, std::uint64_t> trianglesByMaterial(const std::string& glb) {
  std::uint32_t json_bytes = 0;
  std::memcpy(&json_bytes, glb.data() + 12, sizeof json_bytes);
  const auto json = nlohmann::json::parse(glb.substr(20, json_bytes));
  EXPECT_EQ(json["materials"][1]["name"], "cap");
  std::map<int, std::uint64_t> triangles;
  for (const auto& primitive : json["meshes"][0]["primitives"]) {
    const auto& indices = json["accessors"][primitive["indices"].get<std::size_t>()];
    triangles[primitive["material"].get<int>()] += indices["count"].get<std::uint64_t>() / 3;
  }
  return triangles;
}

TEST_F(CapsTest, FilesMarkThem) {
  const auto pyramid =
      open(Index3(40), [](const glm::dvec3& p) { return 25 - glm::distance(p, glm::dvec3(20)); });
  const Query query = cappedQuery();
  const IndexedMesh mesh = meshOf(*pyramid, query);
  const std::string marks(mesh.triangle_caps.begin(), mesh.triangle_caps.end());
  const auto caps = static_cast<std::uint64_t>(std::ranges::count(mesh.triangle_caps, 1));
  const std::uint64_t others = mesh.triangle_caps.size() - caps;
  ASSERT_GT(std::min(caps, others), 0u);
  const auto fileOf = [&](const std::string& name, const MeshFileOptions& options = {}) {
    const auto sink = makeMeshFileSink(folder_.file(name), options);
    extractIsosurface(*pyramid, query, *sink);
    return readBytes(folder_.file(name));
  };
  const std::string ply = fileOf("mesh.ply");
  EXPECT_NE(ply.find("property uchar cap\n"), std::string::npos);
  std::string of_faces;
  for (std::size_t at = ply.size() - 15 * marks.size(); at < ply.size(); at += 15)
    of_faces += ply[at + 14];
  EXPECT_EQ(of_faces, marks);

  const std::string vtp = fileOf("mesh.vtp");
  const std::size_t name = vtp.find("Name=\"cap\"");
  ASSERT_NE(name, std::string::npos);
  const std::size_t offset = std::stoul(vtp.substr(vtp.find("offset=\"", name) + 8));
  const std::string begin = "<AppendedData encoding=\"raw\">\n_";
  const std::size_t first = vtp.find(begin) + begin.size() + offset + 8;  // behind its size
  EXPECT_EQ(vtp.substr(first, marks.size()), marks);

  for (const bool is_packed : {false, true})
    EXPECT_EQ(trianglesByMaterial(fileOf("mesh.glb", {.meshopt = is_packed})),
              (std::map<int, std::uint64_t>{{0, others}, {1, caps}}));

  // Of each group the faces up to the next one.
  std::istringstream obj(fileOf("mesh.obj"));
  std::map<std::string, std::uint64_t> groups;
  std::string group;
  for (std::string line; std::getline(obj, line);) {
    if (line.starts_with("g ")) group = line.substr(2);
    if (line.starts_with("f")) ++groups[group];
  }
  EXPECT_EQ(groups, (std::map<std::string, std::uint64_t>{{"surface", others}, {"cap", caps}}));
}

TEST_F(CapsTest, VoxelsWithoutDataLeaveItOpen) {
  const Index3 dims(24);
  const auto build = [&](bool has_hole) {
    std::vector<float> voxels(static_cast<std::size_t>(elementCount(dims)), 1.0f);
    for (std::int64_t z = 9; has_hole && z < 14; ++z)
      for (std::int64_t y = 9; y < 14; ++y)
        for (std::int64_t x = 0; x < 6; ++x)
          voxels[static_cast<std::size_t>(linearIndex({x, y, z}, dims))] = NAN;
    ArraySource<float> source(dims, voxels);
    BuildOptions options;
    options.brick_cells = 8;
    options.mask_nan = true;
    buildPyramid(source, folder_.file("hole.isb"), options);
    return std::make_shared<const Pyramid>(folder_.file("hole.isb"));
  };
  EXPECT_NEAR(solidOf(meshOf(*build(false), cappedQuery())).volume, 23.0 * 23 * 23, 1e-6);
  const auto pyramid = build(true);
  for (const InsideOf inside : {InsideOf::kAbove, InsideOf::kBelow}) {
    Query query = cappedQuery(inside == InsideOf::kAbove ? 0 : 2);
    query.inside = inside;
    const IndexedMesh mesh = meshOf(*pyramid, query);
    // A face of the box less the cells beside the hole, which are 6 x 6.
    EXPECT_NEAR(capArea(mesh), 6 * 23.0 * 23 - 36, 1e-9);
    const MeshReport report =
        checkMesh(mesh.positions, mesh.triangles, boxOptions(glm::dvec3(0), glm::dvec3(23)));
    EXPECT_TRUE(report.ok()) << report.summary();
    EXPECT_EQ(report.border_loops, 1);
  }
}

TEST_F(CapsTest, AProgressiveQueryHasThemAtTheVolumesBorderAlone) {
  const auto pyramid =
      open(Index3(70), [](const glm::dvec3& p) { return 30 - glm::distance(p, glm::dvec3(0)); });
  Query query = cappedQuery();
  query.is_progressive = true;
  Extractor extractor(*pyramid);
  ExtractionReport report;
  IndexedMesh mesh;
  do {
    IndexedMeshSink sink;
    report = extractor.extract(query, sink);
    mesh = sink.takeMesh();
    EXPECT_GT(solidOf(mesh).volume, 0);
  } while (!report.is_complete && extractor.waitForBricks(std::chrono::milliseconds(50)));
  EXPECT_TRUE(report.is_complete);
  query.is_progressive = false;
  EXPECT_TRUE(mesh.triangles == meshOf(*pyramid, query).triangles);
  query.is_progressive = true;
  query.box = QueryBox{glm::dvec3(0), glm::dvec3(10)};
  IndexedMeshSink sink;
  EXPECT_THROW(extractor.extract(query, sink), Error);
}

}  // namespace
}  // namespace isobrick::test
