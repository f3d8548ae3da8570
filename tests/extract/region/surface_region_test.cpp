// Surfaces of a part of a volume: cut by planes, spheres and masks, open and with caps.
#include "isobrick/extract/surface_region.h"

#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <array>
#include <cmath>
#include <filesystem>
#include <functional>
#include <glm/gtc/matrix_transform.hpp>
#include <map>
#include <numbers>
#include <set>
#include <string>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/one_pass_surface.h"
#include "isobrick/extract/region/region_cutter.h"
#include "isobrick/extract/shares/mesh_share.h"
#include "isobrick/extract/sinks/indexed_mesh.h"
#include "isobrick/extract/sinks/surface_components.h"
#include "isobrick/preprocess/brick_stream.h"
#include "isobrick/storage/index_loop.h"
#include "tests/extract/random_case.h"
#include "tests/support/crossing_triangles.h"
#include "tests/support/field_pyramid.h"
#include "tests/support/hashing_sink.h"
#include "tests/support/mesh_checker.h"
#include "tests/support/repetitions.h"

namespace isobrick::test {
namespace {

constexpr double kPi = std::numbers::pi;

IndexedMesh meshWithin(const Pyramid& pyramid, const Query& query) {
  IndexedMeshSink sink;
  extractIsosurface(pyramid, query, sink);
  return sink.takeMesh();
}

// The area of caps, in world units.
class CapArea : public TriangleSink {
 public:
  void begin(const MeshFrame& frame) override { placement_ = WorldPlacement(frame.geometry); }
  void accept(const MeshBatch& batch) override {
    for (std::size_t i = batch.triangles.size() - batch.cap_indices; i < batch.triangles.size();
         i += 3) {
      std::array<glm::dvec3, 3> at;
      for (std::size_t c = 0; c < 3; ++c)
        at[c] = placement_.worldPosition(batch, batch.triangles[i + c]);
      area_ += glm::length(glm::cross(at[1] - at[0], at[2] - at[0])) / 2;
    }
  }
  double area() const { return area_; }

 private:
  WorldPlacement placement_;
  double area_ = 0;
};

double capAreaOf(const Pyramid& pyramid, const Query& query) {
  CapArea sink;
  extractIsosurface(pyramid, query, sink);
  return sink.area();
}

using Place = std::array<double, 3>;
Place placeOf(const glm::dvec3& p) { return {p.x, p.y, p.z}; }

// The triangles as places, from the least corner on.
std::set<std::array<Place, 3>> trianglesOf(const IndexedMesh& mesh,
                                           const std::function<bool(const glm::dvec3&)>& isWanted) {
  std::set<std::array<Place, 3>> all;
  for (std::size_t i = 0; i < mesh.triangles.size(); i += 3) {
    std::array<Place, 3> corners;
    bool is_wanted = true;
    for (std::size_t c = 0; c < 3; ++c) {
      const glm::dvec3& at = mesh.positions[mesh.triangles[i + c]];
      corners[c] = placeOf(at);
      is_wanted = is_wanted && isWanted(at);
    }
    std::rotate(corners.begin(), std::min_element(corners.begin(), corners.end()), corners.end());
    if (is_wanted) all.insert(corners);
  }
  return all;
}
bool isAnywhere(const glm::dvec3&) { return true; }

// Faults but for open edges: those must lie where `isOpen` says.
void expectSound(const IndexedMesh& mesh, const std::function<bool(const glm::dvec3&)>& isOpen) {
  const MeshReport report = checkMesh(mesh.positions, mesh.triangles);
  EXPECT_EQ(report.bad_indices + report.repeated_indices + report.misoriented_edges +
                report.nonmanifold_edges + report.duplicate_triangles + report.zero_area_triangles +
                report.unreferenced_vertices + report.nonfinite_vertices,
            0)
      << report.summary();
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> sides;
  for (std::size_t i = 0; i < mesh.triangles.size(); i += 3)
    for (std::size_t c = 0; c < 3; ++c) {
      const auto [a, b] = std::minmax(mesh.triangles[i + c], mesh.triangles[i + (c + 1) % 3]);
      ++sides[{a, b}];
    }
  std::int64_t open_inside = 0;
  for (const auto& [side, count] : sides)
    if (count == 1)
      open_inside +=
          isOpen(mesh.positions[side.first]) && isOpen(mesh.positions[side.second]) ? 0 : 1;
  EXPECT_EQ(open_inside, 0);
}

const glm::dvec3 kCenter(23.3, 22.7, 24.1);
constexpr double kRadius = 15;
double ballField(const glm::dvec3& p) { return kRadius - glm::length(p - kCenter); }

class SurfaceRegionTest : public testing::Test {
 protected:
  const TemporaryFolder folder_;
  const std::shared_ptr<const Pyramid> ball_ = openField(folder_, Index3(48), ballField);
  // Through the centre.
  const glm::dvec3 normal_ = glm::normalize(glm::dvec3(1, 0.5, 0.2));
  const HalfSpace half_{3.0 * normal_, 3 * glm::dot(normal_, kCenter)};
  double depth(const glm::dvec3& p) const { return glm::dot(normal_, p - kCenter); }
};

TEST_F(SurfaceRegionTest, APlaneCutsABallStraight) {
  Query query;
  const IndexedMesh whole = meshWithin(*ball_, query);
  query.region.half_spaces = {half_};
  const IndexedMesh mesh = meshWithin(*ball_, query);
  const MeshReport report = checkMesh(mesh.positions, mesh.triangles);
  EXPECT_NEAR(report.area, 2 * kPi * kRadius * kRadius, 0.005 * report.area);
  // The border is the circle of the plane and the sphere.
  expectSound(
      mesh, [&](const glm::dvec3& p) { return std::abs(depth(p)) <= RegionCutter::kNear + 1e-9; });
  for (const glm::dvec3& p : mesh.positions) EXPECT_GE(depth(p), -RegionCutter::kNear - 1e-9);
  EXPECT_EQ(report.components, 1);
  // All else has the bits of the whole surface.
  const auto isInside = [&](const glm::dvec3& p) { return depth(p) > RegionCutter::kNear; };
  const auto kept = trianglesOf(mesh, isInside);
  const auto expected = trianglesOf(whole, isInside);
  EXPECT_FALSE(expected.empty());
  EXPECT_TRUE(std::ranges::includes(kept, expected));
}

TEST_F(SurfaceRegionTest, ACapClosesHalfABall) {
  Query query;
  query.cap = true;
  query.region.half_spaces = {half_};
  const IndexedMesh mesh = meshWithin(*ball_, query);
  const MeshReport report = checkMesh(mesh.positions, mesh.triangles);
  EXPECT_TRUE(report.ok()) << report.summary();
  EXPECT_EQ(report.genus, 0);
  EXPECT_EQ(report.components, 1);
  const double volume = 2.0 / 3 * kPi * std::pow(kRadius, 3);
  EXPECT_NEAR(report.volume, volume, 0.005 * volume);
  const double area = 3 * kPi * kRadius * kRadius;
  EXPECT_NEAR(report.area, area, 0.015 * area);  // the edge is blunt
  EXPECT_NEAR(capAreaOf(*ball_, query), area / 3, 0.05 * area);
  EXPECT_TRUE(crossingTriangles(mesh.positions, mesh.triangles).empty());
  // Normals of the flat side are the plane's, and vertices lie on it.
  std::size_t flat = 0;
  for (std::size_t v = 0; v < mesh.positions.size(); ++v)
    if (glm::length(glm::dvec3(mesh.normals[v]) + normal_) < 1e-6) {
      ++flat;
      EXPECT_NEAR(depth(mesh.positions[v]), 0, 1e-3);
    }
  EXPECT_GT(flat, 500u);
}

// All of it counts as a cap, and its edge is that of the surface in that plane.
TEST_F(SurfaceRegionTest, ACapInAPlaneOfTheLatticeIsADisc) {
  Query query;
  query.cap = true;
  for (const double sign : {1.0, -1.0}) {
    query.region.half_spaces = {{{sign, 0, 0}, sign * 24}};
    const double disc = kPi * (kRadius * kRadius - std::pow(24 - kCenter.x, 2));
    EXPECT_NEAR(capAreaOf(*ball_, query), disc, 0.003 * disc);
    const IndexedMesh mesh = meshWithin(*ball_, query);
    EXPECT_TRUE(checkMesh(mesh.positions, mesh.triangles).ok());
  }
}

TEST_F(SurfaceRegionTest, TheTwoSidesOfAPlaneAreTheBall) {
  Query query;
  query.cap = true;
  double volume = 0;
  for (const double sign : {1.0, -1.0}) {
    query.region.half_spaces = {{sign * half_.normal, sign * (half_.offset - 12)}};
    const IndexedMesh mesh = meshWithin(*ball_, query);
    volume += checkMesh(mesh.positions, mesh.triangles).volume;
  }
  query.region = {};
  const IndexedMesh whole = meshWithin(*ball_, query);
  const double all = checkMesh(whole.positions, whole.triangles).volume;
  EXPECT_NEAR(volume, all, 0.003 * all);
}

TEST_F(SurfaceRegionTest, ASphereOfASlab) {
  const double half = 8, middle = 20.5, radius = 13;
  const auto slab = openField(folder_, Index3(48, 47, 41),
                              [&](const glm::dvec3& p) { return half - std::abs(p.z - middle); });
  Query query;
  query.region.balls = {{{24.2, 22.9, middle}, radius}};
  const IndexedMesh open = meshWithin(*slab, query);
  const double disc = kPi * (radius * radius - half * half);
  EXPECT_NEAR(checkMesh(open.positions, open.triangles).area, 2 * disc, 0.005 * disc);
  query.cap = true;
  const IndexedMesh mesh = meshWithin(*slab, query);
  const MeshReport report = checkMesh(mesh.positions, mesh.triangles);
  EXPECT_TRUE(report.ok()) << report.summary();
  const double volume = 2 * kPi * (radius * radius * half - half * half * half / 3);
  EXPECT_NEAR(report.volume, volume, 0.006 * volume);
  EXPECT_TRUE(crossingTriangles(mesh.positions, mesh.triangles).empty());
}

// Turned, with voxels of other sizes: 7 on one side of a plane of its own, 3 on the other, 0
// around.
class MaskRegionTest : public SurfaceRegionTest {
 protected:
  MaskRegionTest() {
    grid_.direction = glm::dmat3(glm::rotate(glm::dmat4(1.0), 0.5, glm::dvec3(0.2, 0.3, 1)));
    grid_.spacing = {0.7, 1.1, 1.3};
    grid_.origin = kCenter - grid_.direction * (grid_.spacing * glm::dvec3(30, 20, 17));
    BuildOptions options;
    options.brick_cells = 16;
    mask_ = std::make_shared<const Pyramid>(buildField<std::uint8_t>(
        folder_, Index3(61, 41, 35),
        [](const glm::dvec3& p) {
          const bool is_border = p.x < 1 || p.y < 1 || p.z < 1 || p.x > 59 || p.y > 39 || p.z > 33;
          return is_border ? 0 : p.x < 30.5 ? 7 : 3;
        },
        options, grid_, "mask.isb"));
  }
  // Whether the nearest voxel of the mask has the label.
  bool has(const glm::dvec3& voxel, double label) const {
    const glm::dvec3 at = glm::floor(grid_.worldToIndex(voxel) + 0.5);
    const bool is_in =
        at.x >= 1 && at.y >= 1 && at.z >= 1 && at.x <= 59 && at.y <= 39 && at.z <= 33;
    return is_in && (at.x < 30.5 ? 7.0 : 3.0) == label;
  }
  GridGeometry grid_;
  std::shared_ptr<const Pyramid> mask_;
};

TEST_F(MaskRegionTest, LabelsOfATurnedMaskShareABall) {
  Query query;
  query.cap = true;
  const IndexedMesh whole = meshWithin(*ball_, {});
  double volume = 0;
  for (const double label : {7.0, 3.0}) {
    query.region.masks = {{mask_, label}};
    const IndexedMesh mesh = meshWithin(*ball_, query);
    const MeshReport report = checkMesh(mesh.positions, mesh.triangles);
    EXPECT_TRUE(report.ok()) << report.summary();
    EXPECT_TRUE(crossingTriangles(mesh.positions, mesh.triangles).empty());
    // The mask's plane lies half a voxel of the mask beside the centre.
    const double h = kRadius + (label == 7 ? 0.35 : -0.35);
    const double cap_volume = kPi * h * h * (3 * kRadius - h) / 3;
    EXPECT_NEAR(report.volume, cap_volume, 0.012 * cap_volume);
    volume += report.volume;
  }
  const double all = checkMesh(whole.positions, whole.triangles).volume;
  EXPECT_NEAR(volume, all, 0.004 * all);
  // All of it but for the border of the mask, which has the ball inside.
  query.region.masks = {{mask_, std::nullopt}};
  EXPECT_EQ(meshWithin(*ball_, query).triangles, whole.triangles);
}

TEST_F(MaskRegionTest, WithoutCapsTrianglesOfTheWholeSurfaceStay) {
  const IndexedMesh whole = meshWithin(*ball_, {});
  Query query;
  query.region.masks = {{mask_, 7.0}};
  const auto stays = [&](const glm::dvec3& p) {
    return has(glm::floor(p), 7) && has(glm::ceil(p), 7);
  };
  const IndexedMesh mesh = meshWithin(*ball_, query);
  EXPECT_EQ(trianglesOf(mesh, isAnywhere), trianglesOf(whole, stays));
  expectSound(mesh, isAnywhere);
  EXPECT_GT(mesh.triangles.size(), whole.triangles.size() / 3);
}

TEST_F(MaskRegionTest, CappedVerticesBesideNoCutHaveTheirBits) {
  // Of all types of voxels.
  const auto expectBits = [&](const Pyramid& pyramid) {
    Query query;
    query.isovalue = 100;
    const IndexedMesh whole = meshWithin(pyramid, query);
    std::map<Place, glm::vec3> places;
    for (std::size_t v = 0; v < whole.positions.size(); ++v)
      places.emplace(placeOf(whole.positions[v]), whole.normals[v]);
    query.cap = true;
    query.region.masks = {{mask_, 3.0}};
    query.region.balls = {{kCenter + glm::dvec3(3, 2, 1), 13}};
    const IndexedMesh mesh = meshWithin(pyramid, query);
    EXPECT_TRUE(checkMesh(mesh.positions, mesh.triangles).ok());
    const auto isIn = [&](const glm::dvec3& p) {
      return has(p, 3) && glm::length(p - kCenter - glm::dvec3(3, 2, 1)) <= 13;
    };
    std::size_t beside_no_cut = 0;
    for (std::size_t v = 0; v < mesh.positions.size(); ++v) {
      const glm::dvec3 &p = mesh.positions[v], low = glm::floor(p), high = glm::ceil(p);
      if (!isIn(low) || !isIn(high)) continue;
      ++beside_no_cut;
      const auto found = places.find(placeOf(p));
      ASSERT_NE(found, places.end());
      bool are_all_in = true;  // that gradients come from
      for (int axis = 0; axis < 3; ++axis)
        for (const double step : {-1.0, 1.0}) {
          glm::dvec3 way(0.0);
          way[axis] = step;
          are_all_in = are_all_in && isIn(low + way) && isIn(high + way);
        }
      EXPECT_TRUE(!are_all_in || found->second == mesh.normals[v]);
    }
    EXPECT_GT(beside_no_cut, 100u);
  };
  const auto field = [](const glm::dvec3& p) { return 100 + 5 * ballField(p); };
  const auto expectBitsOf = [&](auto value) {
    BuildOptions options;
    options.brick_cells = 16;
    expectBits(
        Pyramid(buildField<decltype(value)>(folder_, Index3(48), field, options, {}, "typed.isb")));
  };
  expectBitsOf(std::uint8_t{});
  expectBitsOf(std::int16_t{});
  expectBitsOf(std::uint16_t{});
  expectBitsOf(float{});
}

TEST_F(MaskRegionTest, OtherWorldsAreRefused) {
  const auto messageOf = [&](const Query& query) -> std::string {
    try {
      meshWithin(*ball_, query);
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  };
  Query query;
  GridGeometry far = grid_;
  far.origin.x += 500;
  query.region.masks = {{openField(folder_, Index3(20), ballField, far), std::nullopt}};
  EXPECT_NE(messageOf(query).find("lies nowhere in"), std::string::npos) << messageOf(query);
  GridGeometry metric = grid_;
  metric.unit = LengthUnit::kMillimetre;
  query.region.masks = {{openField(folder_, Index3(20), ballField, metric), std::nullopt}};
  EXPECT_NE(messageOf(query).find("are unknown, and the grids differ"), std::string::npos)
      << messageOf(query);
  query.region.masks = {{openField(folder_, Index3(20), ballField), 16777217.0}};
  EXPECT_NE(messageOf(query).find("above 16777216"), std::string::npos) << messageOf(query);
  query.region = {};
  query.region.half_spaces = {{glm::dvec3(0.0), 1}};
  EXPECT_NE(messageOf(query).find("clip plane"), std::string::npos);
  query.region.half_spaces = {half_};
  query.cap = true;
  query.uniform_level = 1;
  EXPECT_NE(messageOf(query).find("need level 0"), std::string::npos);
}

SurfaceRegion randomRegion(RandomCase& random, const Pyramid& pyramid) {
  const glm::dvec3 last(pyramid.spec().voxels - Index3(1));
  const auto place = [&] {
    return last * glm::dvec3(random.real(0.2, 0.8), random.real(0.2, 0.8), random.real(0.2, 0.8));
  };
  SurfaceRegion region;
  for (int planes = random.uniform(0, 2); planes > 0; --planes) {
    glm::dvec3 normal(random.real(-1, 1), random.real(-1, 1), random.real(0.1, 1));
    if (random.chance(0.3)) normal = {0, 0, 1};
    region.half_spaces.push_back(
        {normal, glm::dot(normal, random.chance(0.5) ? place() : glm::round(place()))});
  }
  if (region.half_spaces.empty() || random.chance(0.4))
    region.balls.push_back({place(), random.real(1, 1 + glm::length(last) / 2)});
  return region;
}

// How far inside of all walls.
double depthIn(const std::vector<RegionWall>& walls, const glm::dvec3& voxel) {
  double least = 1e30;
  for (const RegionWall& wall : walls) least = std::min(least, wall.depth(voxel));
  return least;
}

TEST(SurfaceRegionCases, RandomQueriesAreCutAlongTheWallsAlone) {
  for (int seed = 1; seed <= repetitions(150); ++seed) {
    SCOPED_TRACE("case " + std::to_string(seed));
    RandomCase random(static_cast<std::uint32_t>(seed));
    const TemporaryFolder folder;
    const Pyramid pyramid(buildRandomPyramid(random, folder, 1));
    Query query = randomQuery(random, pyramid);
    query.box.reset();
    const GridGeometry& geometry = pyramid.spec().geometry;
    query.region = randomRegion(random, pyramid);
    const std::vector<RegionWall> walls = wallsOf(query.region);
    const IndexedMesh mesh = meshWithin(pyramid, query);
    const glm::dvec3 last(pyramid.spec().voxels - Index3(1));
    // Steps of the level and slivers of triangles that were left out come on top of kNear.
    const auto isOpen = [&](const glm::dvec3& p) {
      const glm::dvec3 voxel = geometry.worldToIndex(p);
      for (int axis = 0; axis < 3; ++axis)
        if (std::abs(voxel[axis]) < 1e-6 || std::abs(voxel[axis] - last[axis]) < 1e-6) return true;
      for (const RegionWall& wall : walls)
        if (std::abs(wall.depth(voxel)) < 0.02) return true;
      return false;
    };
    expectSound(mesh, isOpen);
    for (const glm::dvec3& p : mesh.positions)
      EXPECT_GT(depthIn(walls, geometry.worldToIndex(p)), -0.02);

    // The same for any number of threads, and in shares.
    HashingSink whole, other, merged;
    extractIsosurface(pyramid, query, whole);
    tbb::task_arena(random.uniform(1, 4)).execute([&] {
      extractIsosurface(pyramid, query, other);
    });
    EXPECT_EQ(whole.value(), other.value());
    Extractor extractor(pyramid);
    const ExtractionPlan plan = extractor.plan(query);
    std::vector<std::string> paths;
    for (std::uint32_t number = 1; number <= 3; ++number) {
      paths.push_back(folder.file(std::to_string(number) + ".isbm"));
      const NumberRun run = bricksOf(plan, {number, 3});
      const auto sink = makeMeshShareSink(paths.back(), pyramid, plan, {number, 3});
      extractor.execute(plan, run.first, run.count, *sink);
    }
    mergeMeshShares(paths, merged);
    EXPECT_EQ(whole.value(), merged.value());
    if (HasFailure()) return;
  }
}

TEST(SurfaceRegionCases, RandomSolidsAreClosed) {
  for (int seed = 1; seed <= repetitions(150); ++seed) {
    SCOPED_TRACE("case " + std::to_string(seed));
    RandomCase random(static_cast<std::uint32_t>(seed));
    const Index3 dims = random.dims();
    // Outside all around, so that the border of the volume has no part.
    std::vector<float> values = random.field<float>(dims);
    for (std::size_t i = 0; i < values.size(); ++i) {
      const Index3 voxel = indexAt(static_cast<std::int64_t>(i), dims);
      for (int axis = 0; axis < 3; ++axis)
        if (voxel[axis] == 0 || voxel[axis] == dims[axis] - 1) values[i] = -1;
    }
    const TemporaryFolder folder;
    BuildOptions options;
    options.brick_cells = 8;
    ArraySource<float> source(dims, values);
    const VolumeInfo info = source.info();
    buildPyramid(source, folder.file("case.isb"), options);
    const Pyramid pyramid(folder.file("case.isb"));
    Query query;
    query.isovalue = std::round(random.real(1, 180));
    query.cap = true;
    query.region = randomRegion(random, pyramid);
    const IndexedMesh mesh = meshWithin(pyramid, query);
    const MeshReport report = checkMesh(mesh.positions, mesh.triangles);
    // Marching cubes pinches no vertex, and neither do caps.
    EXPECT_TRUE(report.ok()) << report.summary();
    EXPECT_TRUE(crossingTriangles(mesh.positions, mesh.triangles).empty());

    query.simplify = SimplifyOptions{0.5};
    const IndexedMesh simple = meshWithin(pyramid, query);
    EXPECT_EQ(checkMesh(simple.positions, simple.triangles).open_edges, 0);
    query.simplify.reset();

    // The same straight from the volume.
    for (const bool caps : {true, false}) {
      query.cap = caps;
      IndexedMeshSink expected, streamed;
      buildPyramid(*std::make_unique<ArraySource<float>>(dims, values), folder.file("default.isb"),
                   {});
      extractIsosurface(Pyramid(folder.file("default.isb")), query, expected);
      BrickStreamOptions stream_options;
      stream_options.open = [&] { return std::make_unique<ArraySource<float>>(dims, values); };
      BrickStream stream(std::move(stream_options));
      OnePassSurface surface(stream.pyramid(), query, streamed);
      stream.run(finestBricksOf(stream.pyramid().layout(), query),
                 [&](const IndexBox& bricks) { surface.mesh(bricks); });
      surface.finish();
      EXPECT_EQ(expected.mesh().positions, streamed.mesh().positions);
      EXPECT_EQ(expected.mesh().triangles, streamed.mesh().triangles);
      std::filesystem::remove(folder.file("default.isb"));
    }
    if (HasFailure()) return;
  }
}

TEST_F(SurfaceRegionTest, ThePiecesOfAnOpenSurfaceHaveNoVolume) {
  Query query;
  query.region.half_spaces = {half_};
  for (const bool caps : {false, true}) {
    query.cap = caps;
    ComponentFinder finder(query);
    extractIsosurface(*ball_, query, finder);
    const SurfaceComponents components = finder.take();
    ASSERT_EQ(components.list().size(), 1u);
    EXPECT_EQ(components.list()[0].volume.has_value(), caps);
  }
}

}  // namespace
}  // namespace isobrick::test
