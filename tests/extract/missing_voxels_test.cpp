// Surfaces of volumes with voxels without data: BuildOptions::mask_nan.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/indexed_mesh.h"
#include "isobrick/extract/sinks/surface_components.h"
#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/pyramid_parts.h"
#include "isobrick/storage/pyramid_verify.h"
#include "tests/extract/random_case.h"
#include "tests/extract/same_mesh.h"
#include "tests/support/array_source.h"
#include "tests/support/build_message.h"
#include "tests/support/file_bytes.h"
#include "tests/support/mesh_checker.h"
#include "tests/support/plain_reader.h"
#include "tests/support/reference_mesher.h"
#include "tests/support/repetitions.h"
#include "tests/support/sealed_pyramid.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

BuildOptions maskingOptions(std::int64_t brick_cells = 8) {
  BuildOptions options;
  options.brick_cells = brick_cells;
  options.mask_nan = true;
  return options;
}

std::shared_ptr<const Pyramid> buildMasked(const TemporaryFolder& folder, const Index3& dims,
                                           const std::vector<float>& voxels,
                                           const BuildOptions& options = maskingOptions()) {
  ArraySource<float> source(dims, voxels);
  const std::string path = folder.file("masked.isb");
  buildPyramid(source, path, options);
  return std::make_shared<const Pyramid>(path);
}

std::uint64_t countOfNan(const std::vector<float>& voxels) {
  return static_cast<std::uint64_t>(
      std::count_if(voxels.begin(), voxels.end(), [](float v) { return std::isnan(v); }));
}

IndexedMesh meshOf(const Pyramid& pyramid, const Query& query) {
  IndexedMeshSink sink;
  extractIsosurface(pyramid, query, sink);
  return sink.mesh();
}

using Point = std::array<double, 3>;
using Corners = std::array<Point, 3>;

// The triangles as places, whatever their numbers and first corners.
std::multiset<Corners> trianglesOf(const IndexedMesh& mesh) {
  std::multiset<Corners> all;
  for (std::size_t t = 0; t < mesh.triangles.size(); t += 3) {
    Corners corners;
    for (std::size_t i = 0; i < 3; ++i) {
      const glm::dvec3 p(mesh.positions[mesh.triangles[t + i]]);
      corners[i] = {p.x, p.y, p.z};
    }
    std::rotate(corners.begin(), std::min_element(corners.begin(), corners.end()), corners.end());
    all.insert(corners);
  }
  return all;
}

// The edges of one triangle alone, as places, but for those in the volume's border.
std::set<std::pair<Point, Point>> openEdgesOf(const IndexedMesh& mesh, const Index3& dims) {
  const auto isInBorder = [&](const Point& a, const Point& b) {
    for (int axis = 0; axis < 3; ++axis)
      for (const double side : {0.0, static_cast<double>(dims[axis] - 1)})
        if (a[static_cast<std::size_t>(axis)] == side && b[static_cast<std::size_t>(axis)] == side)
          return true;
    return false;
  };
  std::map<std::pair<Point, Point>, int> uses;
  for (const Corners& corners : trianglesOf(mesh))
    for (std::size_t i = 0; i < 3; ++i) ++uses[std::minmax(corners[i], corners[(i + 1) % 3])];
  std::set<std::pair<Point, Point>> open;
  for (const auto& [edge, count] : uses)
    if (count == 1 && !isInBorder(edge.first, edge.second)) open.insert(edge);
  return open;
}

// Nothing is wrong but that it is open. Where single voxels have no data, pieces may meet in a
// vertex.
void expectSound(const IndexedMesh& mesh, const Index3& dims, bool may_be_pinched = false) {
  MeshReport report = checkMesh(mesh.positions, mesh.triangles, indexOptions(dims));
  report.open_edges = 0;
  if (may_be_pinched) report.pinched_vertices = 0;
  EXPECT_TRUE(report.ok()) << report.summary();
  for (const glm::vec3& normal : mesh.normals)
    ASSERT_NEAR(glm::length(glm::dvec3(normal)), 1.0, 1e-5);
}

// ---- a ball of which a half has no data

constexpr Index3 kDims(33, 30, 31);
constexpr std::int64_t kFirstMissing = 18;

float ballAt(const Index3& p) {
  return static_cast<float>(10.3 - glm::length(glm::dvec3(p) - glm::dvec3(16.2, 15.1, 14.7)));
}
std::vector<float> halfBall() {
  return arrayOfField<float>(
      kDims, [](const Index3& p) { return p.x < kFirstMissing ? ballAt(p) : kNan; });
}

TEST(MissingVoxels, LeaveOutTheCellsThatTouchThemAndNothingElse) {
  const TemporaryFolder folder;
  ArraySource<float> source(kDims, arrayOfField<float>(kDims, ballAt));
  BuildOptions plain;
  plain.brick_cells = 8;
  buildPyramid(source, folder.file("whole.isb"), plain);
  const Pyramid whole(folder.file("whole.isb"));
  std::multiset<Corners> expected;
  for (const Corners& corners : trianglesOf(meshOf(whole, {}))) {
    const double middle = (corners[0][0] + corners[1][0] + corners[2][0]) / 3;
    if (middle < static_cast<double>(kFirstMissing - 1)) expected.insert(corners);
  }
  for (const std::int64_t brick : {4, 8, 16, 64}) {
    const auto pyramid = buildMasked(folder, kDims, halfBall(), maskingOptions(brick));
    EXPECT_EQ(pyramid->missingVoxels(), countOfNan(halfBall()));
    const IndexedMesh mesh = meshOf(*pyramid, {});
    EXPECT_EQ(trianglesOf(mesh), expected) << brick;
    expectSound(mesh, kDims);
    for (const auto& [a, b] : openEdgesOf(mesh, kDims))
      EXPECT_TRUE(a[0] == kFirstMissing - 1 && b[0] == kFirstMissing - 1);
    // In memory the same, by another way.
    SurfaceMesh in_memory;
    Extractor extractor(*pyramid);
    extractor.extract({}, in_memory);
    EXPECT_EQ(in_memory.triangles().size(), mesh.triangles.size());
    // Normals at the border are those of a ball: differences are one-sided there.
    for (std::size_t v = 0; v < mesh.positions.size(); ++v) {
      const glm::dvec3 outwards =
          glm::normalize(glm::dvec3(mesh.positions[v]) - glm::dvec3(16.2, 15.1, 14.7));
      EXPECT_GT(glm::dot(glm::dvec3(mesh.normals[v]), outwards), 0.99);
    }
  }
}

TEST(MissingVoxels, HaveNoSkinOnAnyLevelAndAroundAFocus) {
  const TemporaryFolder folder;
  const auto pyramid = buildMasked(folder, kDims, halfBall());
  std::vector<Query> queries(4);
  for (int level = 0; level < 3; ++level)
    queries[static_cast<std::size_t>(level)].uniform_level = level;
  queries[3].focus = FocusSphere{{18, 15, 8}, 3};
  for (Query query : queries) {
    const IndexedMesh mesh = meshOf(*pyramid, query);
    ASSERT_FALSE(mesh.triangles.empty());
    expectSound(mesh, kDims);
    for (const glm::dvec3& p : mesh.positions)
      EXPECT_LE(p.x, static_cast<double>(kFirstMissing - 1));
    // The same without culling; simplified, with the border where it was.
    query.cull_by_ranges = false;
    EXPECT_EQ(trianglesOf(meshOf(*pyramid, query)), trianglesOf(mesh));
    query.simplify = SimplifyOptions{.distance = 0.5};
    const IndexedMesh simple = meshOf(*pyramid, query);
    expectSound(simple, kDims);
    EXPECT_EQ(openEdgesOf(simple, kDims), openEdgesOf(mesh, kDims));
    EXPECT_LE(simple.triangles.size(), mesh.triangles.size());
  }
}

TEST(MissingVoxels, AreThoseOfTheVoxelOnEveryLevelAndLinearFieldsStayExact) {
  const TemporaryFolder folder;
  RandomCase random(3);
  const Index3 dims(21, 18, 27);
  const auto valueAt = [](const Index3& p) { return static_cast<float>(3 * p.x - 2 * p.y + p.z); };
  std::vector<float> voxels = arrayOfField<float>(
      dims, [&](const Index3& p) { return random.chance(0.2) ? kNan : valueAt(p); });
  for (const auto filter : {format::Filter::kAverage, format::Filter::kSubsample})
    for (const auto codec : {format::Codec::kStored, format::Codec::kLz4, format::Codec::kZstd}) {
      BuildOptions options = maskingOptions();
      options.filter = filter;
      options.codec = codec;
      const auto pyramid = buildMasked(folder, dims, voxels, options);
      const Lattice& lattice = pyramid->lattice();
      for (int level = 0; level < lattice.levels(); ++level)
        forEachIndex({Index3(0), pyramid->layout().bricks(level)}, [&](const Index3& brick) {
          const BrickSamples samples = pyramid->samples(level, brick);
          std::int64_t number = 0;
          forEachIndex(samples.box, [&](const Index3& at) {
            const float sample = samples.data<float>()[number++];
            const Index3 place = lattice.position(level, at);
            const float voxel = voxels[static_cast<std::size_t>(linearIndex(place, dims))];
            ASSERT_EQ(std::isnan(sample), std::isnan(voxel));
            if (!std::isnan(voxel)) {
              ASSERT_EQ(sample, voxel);
            }
          });
        });
      const PyramidFaults faults = verifyPyramid(*pyramid, {});
      for (const std::string& fault : faults.rest) ADD_FAILURE() << fault;
      for (const BrickDamage& damage : faults.bricks) ADD_FAILURE() << damage.what;
      const PlainPyramid plain = readPlainPyramid(pyramid->path());
      EXPECT_EQ(plain.missing_voxels, countOfNan(voxels));
    }
}

// Bricks and tiles without any data cost nothing, and cross no isovalue.
TEST(MissingVoxels, MakeEmptyBricks) {
  const TemporaryFolder folder;
  const auto pyramid = buildMasked(folder, kDims, halfBall(), maskingOptions(4));
  const ValueRange range = pyramid->brickRange(0, {7, 2, 2});
  EXPECT_GT(range.min, range.max);
  const PlainPyramid plain = readPlainPyramid(pyramid->path());
  EXPECT_EQ(plain.bricks[7 + 8 * (2 + 8 * 2)].parts[0].codec, 1u);
  for (const float isovalue : {-1e38f, -3.0f, 0.0f, 5.0f, 1e38f})
    EXPECT_FALSE(range.crosses(isovalue));
  Query query;
  query.isovalue = -100;
  EXPECT_TRUE(meshOf(*pyramid, query).triangles.empty());
}

TEST(MissingVoxels, OpenSurfacesEncloseNothing) {
  const TemporaryFolder folder;
  const auto pyramid = buildMasked(folder, kDims, halfBall());
  ComponentFinder finder({});
  extractIsosurface(*pyramid, {}, finder);
  const SurfaceComponents components = finder.take();
  ASSERT_EQ(components.list().size(), 1u);
  EXPECT_FALSE(components.list()[0].volume);
  EXPECT_FALSE(components.list()[0].enclosed);
}

// ---- random voxels without data, random queries

// Half-spaces, balls, single voxels, or all but a ball.
void takeDataAway(RandomCase& random, const Index3& dims, std::vector<float>& voxels) {
  const int kind = random.uniform(0, 3);
  const int axis = random.uniform(0, 2);
  const double share = random.chance(0.5) ? 0.01 : 0.2;
  const glm::dvec3 middle(random.real(0, static_cast<double>(dims.x)),
                          random.real(0, static_cast<double>(dims.y)),
                          random.real(0, static_cast<double>(dims.z)));
  const double radius = random.real(0, static_cast<double>(std::max({dims.x, dims.y, dims.z})));
  std::size_t i = 0;
  forEachIndex({Index3(0), dims}, [&](const Index3& p) {
    const bool is_in = glm::length(glm::dvec3(p) - middle) < radius;
    const bool is_missing = kind == 0   ? static_cast<double>(p[axis]) > middle[axis]
                            : kind == 1 ? is_in
                            : kind == 2 ? !is_in
                                        : random.chance(share);
    if (is_missing) voxels[i] = kNan;
    ++i;
  });
}

void runMaskedVolume(std::uint32_t seed, const TemporaryFolder& folder, int& with_transitions,
                     int& with_border) {
  RandomCase random(seed);
  const Index3 dims = random.dims();
  std::vector<float> voxels = random.field<float>(dims);
  const std::vector<float> whole = voxels;
  takeDataAway(random, dims, voxels);
  if (countOfNan(voxels) == voxels.size()) return;
  BuildOptions options = maskingOptions(std::int64_t{4} << random.uniform(0, 3));
  options.tile_cells = std::min(options.brick_cells, std::int64_t{2} << random.uniform(0, 2));
  const auto pyramid = buildMasked(folder, dims, voxels, options);
  ReferencePyramid reference_pyramid = buildReferencePyramid<float>(dims, voxels);
  reference_pyramid.has_missing = true;
  const PyramidFaults faults = verifyPyramid(*pyramid, {});
  ASSERT_TRUE(faults.rest.empty() && faults.bricks.empty());
  for (int q = 0; q < 6; ++q) {
    SCOPED_TRACE("seed " + std::to_string(seed) + " query " + std::to_string(q));
    Query query;
    query.isovalue = static_cast<double>(
        whole[static_cast<std::size_t>(random.uniform(0, static_cast<int>(whole.size()) - 1))]);
    if (random.chance(0.4)) query.isovalue += random.real(-3, 3);
    query.cull_by_ranges = random.chance(0.8);
    ReferenceQuery expected;
    expected.iso = query.isovalue;
    if (random.chance(0.75)) {
      FocusSphere focus;
      for (int axis = 0; axis < 3; ++axis)
        focus.center[axis] = random.real(0, static_cast<double>(dims[axis] - 1));
      focus.radius = random.real(0, 6);
      query.focus = focus;
      expected.focus = focus.center;
      expected.radius = focus.radius;
    } else {
      query.uniform_level = random.uniform(0, pyramid->lattice().levels() - 1);
      expected.level = *query.uniform_level;
    }
    IndexedMeshSink sink;
    const ExtractionReport report = extractIsosurface(*pyramid, query, sink);
    const ReferenceMesh reference = referenceMesh(reference_pyramid, expected);
    expectSameMesh(sink.mesh(), reference, report);
    expectSound(sink.mesh(), dims, true);
    if (testing::Test::HasFatalFailure() || testing::Test::HasNonfatalFailure()) return;
    with_transitions += reference.transitionCellCount() > 0 ? 1 : 0;
    const auto open = openEdgesOf(sink.mesh(), dims);
    with_border += open.empty() ? 0 : 1;
    SurfaceMesh in_memory;
    Extractor extractor(*pyramid);
    extractor.extract(query, in_memory);
    ASSERT_EQ(in_memory.triangles().size(), sink.mesh().triangles.size());
    // A pyramid of which nothing is resident answers soundly, and in the end the same.
    const Pyramid cold(pyramid->path());
    Extractor asked_again(cold);
    Query progressive = query;
    progressive.is_progressive = true;
    for (bool is_complete = q > 0; !is_complete;) {
      IndexedMeshSink answer;
      is_complete = asked_again.extract(progressive, answer).is_complete;
      expectSound(answer.mesh(), dims, true);
      if (is_complete) {
        ASSERT_EQ(answer.mesh().positions, sink.mesh().positions);
        ASSERT_EQ(answer.mesh().triangles, sink.mesh().triangles);
      } else {
        ASSERT_TRUE(asked_again.waitForBricks(std::chrono::seconds(10)));
      }
    }
    query.simplify = SimplifyOptions{.distance = random.real(0.1, 2)};
    const IndexedMesh simple = meshOf(*pyramid, query);
    expectSound(simple, dims, true);
    ASSERT_EQ(openEdgesOf(simple, dims), open);
  }
}

TEST(MissingVoxels, MatchTheReferenceOnRandomQueries) {
  const TemporaryFolder folder;
  int with_transitions = 0, with_border = 0;
  const int volumes = repetitions(100);
  for (int seed = 0; seed < volumes && !HasFailure(); ++seed)
    runMaskedVolume(static_cast<std::uint32_t>(seed), folder, with_transitions, with_border);
  EXPECT_GT(with_transitions, volumes);
  EXPECT_GT(with_border, 2 * volumes);
}

// ---- what becomes of which voxels

TEST(MissingVoxels, OfAVolumeWithoutNanTheFileIsTheOrdinaryOne) {
  const TemporaryFolder folder;
  std::vector<PlainPyramid> built;
  for (const bool masks : {false, true}) {
    ArraySource<float> source(kDims, arrayOfField<float>(kDims, ballAt));
    BuildOptions options;
    options.brick_cells = 8;
    options.mask_nan = masks;
    buildPyramid(source, folder.file("whole.isb"), options);
    const Pyramid pyramid(folder.file("whole.isb"));
    EXPECT_EQ(pyramid.missingVoxels(), 0u);
    EXPECT_FALSE(pyramid.spec().has_missing);
    built.push_back(readPlainPyramid(folder.file("whole.isb")));
  }
  ASSERT_EQ(built[0].bricks.size(), built[1].bricks.size());
  for (std::size_t i = 0; i < built[0].bricks.size(); ++i) {
    EXPECT_EQ(built[0].bricks[i].samples, built[1].bricks[i].samples);
    EXPECT_EQ(built[0].bricks[i].range.min, built[1].bricks[i].range.min);
  }
}

TEST(MissingVoxels, InfiniteOnesAreRefusedOrReplaced) {
  const TemporaryFolder folder;
  std::vector<float> voxels = halfBall();
  voxels[100] = std::numeric_limits<float>::infinity();
  const std::string path = folder.file("masked.isb");
  {
    ArraySource<float> source(kDims, voxels);
    EXPECT_NE(messageOfBuild(source, path, maskingOptions()).find("infinite"), std::string::npos);
  }
  ArraySource<float> source(kDims, voxels);
  BuildOptions options = maskingOptions();
  options.nan_as = -7;
  const BuildReport report = buildPyramid(source, path, options);
  EXPECT_EQ(report.replaced_voxels, 1u);
  EXPECT_EQ(report.missing_voxels, countOfNan(voxels));
  const auto notes = nlohmann::json::parse(Pyramid(path).provenance()).at("notes");
  ASSERT_EQ(notes.size(), 2u);
  EXPECT_NE(notes[1].get<std::string>().find("have no data"), std::string::npos);
}

TEST(MissingVoxels, AVolumeWithoutAnyDataIsRefused) {
  const TemporaryFolder folder;
  ArraySource<float> source(kDims, std::vector<float>(kDims.x * kDims.y * kDims.z, kNan));
  EXPECT_NE(messageOfBuild(source, folder.file("none.isb"), maskingOptions()).find("all are NaN"),
            std::string::npos);
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

TEST(MissingVoxels, AHeaderThatLiesAboutThemIsRefused) {
  const TemporaryFolder folder;
  const std::string path = buildMasked(folder, kDims, halfBall())->path();
  const std::string good = readBytes(path);
  PyramidDraft draft(Bytes(good.begin(), good.end()));
  const auto writeAll = [](const std::string& to, const Bytes& bytes) {
    writeBytes(to, std::string(bytes.begin(), bytes.end()));
  };
  for (const std::uint64_t lie : {std::uint64_t{1} << 62, std::uint64_t(elementCount(kDims))}) {
    draft.header.missing_voxels = lie;
    writeAll(folder.file("lie.isb"), draft.seal());
    EXPECT_THROW(Pyramid(folder.file("lie.isb")), Error);
  }
  // NaN that the header does not mention.
  draft.header.missing_voxels = 0;
  writeAll(folder.file("lie.isb"), draft.seal());
  const Pyramid lying(folder.file("lie.isb"));
  EXPECT_FALSE(verifyPyramid(lying, {}).bricks.empty());
}

}  // namespace
}  // namespace isobrick::test
