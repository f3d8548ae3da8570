// The extractor against the reference mesher over random volumes and random queries (rule 11 in
// every case, the same crossings to the bit, the same triangle counts): six queries a volume, some
// volumes in bricks with rows of several words. ISOBRICK_PROPERTY_SEED is the first seed.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <random>
#include <set>
#include <tuple>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/oracles/leaf_classifier.h"
#include "isobrick/extract/sinks/indexed_mesh.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/storage/deviation_code.h"
#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/pyramid_parts.h"
#include "tests/extract/random_case.h"
#include "tests/extract/same_mesh.h"
#include "tests/support/array_source.h"
#include "tests/support/crossing_triangles.h"
#include "tests/support/mesh_checker.h"
#include "tests/support/reference_mesher.h"
#include "tests/support/repetitions.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

constexpr int kQueriesPerVolume = 6;

// Counts of what the random queries exercised; a generator that drifts to empty meshes is a test
// that cannot fail.
struct SeenCases {
  int queries = 0, with_triangles = 0, with_transitions = 0, with_two_levels = 0, flattened = 0,
      seen = 0, combined = 0;
};

// The curvature decision of one cell of level 1, from what the pyramid says of it.
bool isFlatByPyramid(const Pyramid& pyramid, float isovalue, double tolerance, const Index3& cell) {
  const BrickLayout& layout = pyramid.layout();
  const Index3 brick = std::int64_t{2} * cell / layout.brickCells();
  std::vector<ValueRange> tiles;
  std::vector<std::uint8_t> codes;
  pyramid.tileRanges(0, brick, tiles);
  pyramid.parts().curvature(brick, codes);
  const Index3 local = std::int64_t{2} * cell - brick * layout.brickCells();
  const Index3 block = local / layout.curvatureCells();
  const auto number =
      static_cast<std::size_t>(linearIndex(block, layout.brickCurvatureBlocks(brick)));
  return static_cast<double>(deviationBound(&codes[kDeviationCoefficients * number],
                                            curvatureBlockRange(layout, brick, tiles, block),
                                            isovalue)) <= 1.5 * std::sqrt(2 * tolerance);
}

// The leaves that the fast classifier sees, cell by cell.
void expectSameLeaves(const Pyramid& pyramid, const Query& query, const LeafLevels& expected) {
  const auto oracles = oraclesOf(pyramid, query);
  const WorldFrame frame(pyramid.spec().geometry);
  ReadLog log;
  const MeshContext context{pyramid, query, oracles, frame, static_cast<float>(query.isovalue),
                            log};
  LeafClassifier classifier(context, BrickReads::kAllowed);
  const Index3 cells = pyramid.lattice().cells(0);
  Index3 cell;
  for (cell.z = 0; cell.z < cells.z; ++cell.z)
    for (cell.y = 0; cell.y < cells.y; ++cell.y)
      for (cell.x = 0; cell.x < cells.x; ++cell.x) {
        const int level = expected.leafLevelAt(cell);
        ASSERT_EQ(classifier.state(level, cell / (std::int64_t{1} << level)), CellState::kLeaf);
      }
}

// The view's decision as the header of the oracle has it, in voxels, which are the world here.
bool isSeen(const ViewPoint& view, int level, const Index3& cell) {
  const double d = std::sqrt(3.0) * (1 + std::ldexp(1.0, -20));
  const double edge = std::ldexp(1.0, level);
  const glm::dvec3 from_eye = (glm::dvec3(cell) + 0.5) * edge - view.eye;
  const double slope = std::max(view.pixels_per_radian / view.pixels + d / 2, 3 * d / 2);
  if (view.pixels_per_unit ? edge * *view.pixels_per_unit <= view.pixels
                           : glm::length(from_eye) >= slope * edge)
    return false;
  if (!view.field) return true;
  const double ahead = glm::dot(from_eye, glm::normalize(view.field->direction));
  const double beside = std::sqrt(std::max(0.0, glm::dot(from_eye, from_eye) - ahead * ahead));
  const double angle = view.field->half_angle;
  const double outside = view.pixels_per_unit ? beside - view.field->radius
                                              : beside * std::cos(angle) - ahead * std::sin(angle);
  return outside < (3 * edge / 2 - 1) * d;
}

LeafLevels referenceLeaves(const Pyramid& pyramid, double isovalue, const DetailChoice& choice) {
  ReferenceQuery expected;
  expected.iso = isovalue;
  if (choice.focus) {
    expected.focus = choice.focus->center;
    expected.radius = choice.focus->radius;
  }
  expected.level = choice.uniform_level.value_or(-1);
  if (choice.curvature_tolerance)
    expected.flat = [&, iso = static_cast<float>(isovalue)](const Index3& cell) {
      return isFlatByPyramid(pyramid, iso, *choice.curvature_tolerance, cell);
    };
  expected.further = [&](int level, const Index3& cell) {
    return !choice.view || isSeen(*choice.view, level, cell);
  };
  return referenceLeafLevels(pyramid.lattice(), expected);
}

// The same query with caps, at the border of the volume or of a box: closed, as the reference says,
// and with what is on the other side of the isovalue it fills the box.
void expectCaps(const Pyramid& pyramid, const ReferencePyramid& reference_pyramid,
                const ReferenceMesh& reference, Query query, RandomCase& random) {
  const Index3 dims = pyramid.spec().voxels;
  query.cap = true;
  if (random.chance(0.4)) {
    QueryBox& box = query.box.emplace();
    for (int axis = 0; axis < 3; ++axis) {
      const auto last = static_cast<double>(dims[axis] - 1);
      box.min[axis] = random.real(-1, last - 0.1);
      box.max[axis] = random.real(std::max(box.min[axis], 0.0) + 0.05, last + 1);
    }
    SCOPED_TRACE("box");
  }
  double volumes[2] = {};
  Index3 low(0), high = dims - Index3(1);
  for (const InsideOf inside : {InsideOf::kAbove, InsideOf::kBelow}) {
    query.inside = inside;
    Extractor extractor(pyramid);
    const ExtractionPlan plan = extractor.plan(query);
    if (query.box) {
      low = Index3(plan.query().box->min);
      high = Index3(plan.query().box->max);
      for (int axis = 0; axis < 3; ++axis) {
        ASSERT_LE(static_cast<double>(low[axis]), std::max(query.box->min[axis], 0.0));
        ASSERT_GE(static_cast<double>(high[axis]),
                  std::min(query.box->max[axis], static_cast<double>(dims[axis] - 1)));
      }
    }
    IndexedMeshSink sink;
    const ExtractionReport report = extractor.execute(plan, 0, plan.bricks().size(), sink);
    const IndexedMesh& mesh = sink.mesh();
    const MeshReport check = checkMesh(mesh.positions, mesh.triangles);
    ASSERT_TRUE(check.ok()) << check.summary();
    ASSERT_TRUE(crossingTriangles(mesh.positions, mesh.triangles).empty());
    const ReferenceCaps caps = referenceCaps(reference_pyramid, reference.leaves, query.isovalue,
                                             low, high, inside == InsideOf::kBelow);
    expectSameCaps(mesh, caps, low, high);
    if (!query.box && inside == InsideOf::kAbove) expectSameMesh(mesh, reference, report, caps);
    if (testing::Test::HasFatalFailure()) return;
    volumes[inside == InsideOf::kBelow ? 1 : 0] = check.volume;
    EXPECT_GE(check.volume, 0);
    query.cull_by_ranges = random.chance(0.5);
  }
  const glm::dvec3 extent(high - low);
  EXPECT_NEAR(volumes[0] + volumes[1], extent.x * extent.y * extent.z,
              1e-9 * extent.x * extent.y * extent.z);
}

// Bricks of up to 64 cells, whose rows of bits are one word, or rows of two to four words.
enum class Rows { kOneWord, kSeveralWords };

template <typename T>
void runVolume(std::uint32_t seed, Rows rows, const TemporaryFolder& folder, SeenCases& coverage) {
  RandomCase random(seed);
  const bool is_wide = rows == Rows::kSeveralWords;
  const Index3 dims = is_wide ? random.wideDims() : random.dims();
  const std::vector<T> values = random.field<T>(dims);
  BuildOptions options;
  options.brick_cells =
      is_wide ? std::int64_t{128} << random.uniform(0, 1) : std::int64_t{4} << random.uniform(0, 4);
  options.tile_cells = std::min(options.brick_cells, std::int64_t{2} << random.uniform(0, 2));
  const bool subsample = random.chance(0.2);
  options.filter = subsample ? format::Filter::kSubsample : format::Filter::kAverage;
  ArraySource<T> source(dims, values);
  const std::string path = folder.file("case.isb");
  buildPyramid(source, path, options);
  const Pyramid pyramid(path);
  const ReferencePyramid reference_pyramid = buildReferencePyramid<T>(
      dims, values, subsample ? ReferenceFilter::kSubsample : ReferenceFilter::kAverage);

  for (int q = 0; q < kQueriesPerVolume; ++q) {
    SCOPED_TRACE("seed " + std::to_string(seed) + " query " + std::to_string(q) + " dims " +
                 std::to_string(dims.x) + "x" + std::to_string(dims.y) + "x" +
                 std::to_string(dims.z) + " brick " + std::to_string(options.brick_cells));
    Query query;
    const auto sample = static_cast<double>(
        values[static_cast<std::size_t>(random.uniform(0, static_cast<int>(values.size()) - 1))]);
    query.isovalue = random.chance(0.6) ? sample : sample + random.real(-3, 3);
    static_cast<DetailChoice&>(query) = randomChoice(random, pyramid, 0.85);
    LeafLevels leaves = referenceLeaves(pyramid, query.isovalue, query);
    if (random.chance(0.25))
      for (int further = random.uniform(1, 2); further > 0; --further) {
        query.or_finer.push_back(randomChoice(random, pyramid, 1));
        leaves = finerLeafLevels(leaves,
                                 referenceLeaves(pyramid, query.isovalue, query.or_finer.back()));
      }
    IndexedMeshSink sink;
    const ExtractionReport report = extractIsosurface(pyramid, query, sink);
    const MeshReport check =
        checkMesh(sink.mesh().positions, sink.mesh().triangles, indexOptions(dims));
    ASSERT_TRUE(check.ok()) << check.summary();
    const ReferenceMesh reference = referenceMesh(reference_pyramid, leaves, query.isovalue);
    expectSameMesh(sink.mesh(), reference, report);
    ASSERT_TRUE(crossingTriangles(sink.mesh().positions, sink.mesh().triangles).empty());
    if (testing::Test::HasFatalFailure()) return;
    ASSERT_TRUE(auditLeafLevels(reference.leaves).empty());
    expectSameLeaves(pyramid, query, reference.leaves);
    if (testing::Test::HasFatalFailure()) return;

    ++coverage.queries;
    coverage.with_triangles += report.triangles > 0 ? 1 : 0;
    coverage.with_transitions += reference.transitionCellCount() > 0 ? 1 : 0;
    coverage.with_two_levels += report.levels.size() > 1 ? 1 : 0;
    coverage.flattened += query.curvature_tolerance && report.levels.size() > 1 ? 1 : 0;
    coverage.seen += query.view && report.levels.size() > 1 ? 1 : 0;
    coverage.combined += !query.or_finer.empty() && report.levels.size() > 1 ? 1 : 0;

    query.cull_by_ranges = false;
    IndexedMeshSink unculled;
    const ExtractionReport unculled_report = extractIsosurface(pyramid, query, unculled);
    expectSameMesh(unculled.mesh(), reference, unculled_report);
    if (testing::Test::HasFatalFailure()) return;
    query.cull_by_ranges = true;
    RandomCase caps(seed + 7919 * static_cast<std::uint32_t>(q));
    expectCaps(pyramid, reference_pyramid, reference, query, caps);
    if (testing::Test::HasFatalFailure()) return;
  }
}

SeenCases runVolumes(int volumes, Rows rows) {
  const TemporaryFolder folder;
  const int first = environmentOr("ISOBRICK_PROPERTY_SEED", 1);
  SeenCases coverage;
  for (int v = 0; v < volumes && !testing::Test::HasFatalFailure(); ++v) {
    const auto seed = static_cast<std::uint32_t>(first + v);
    visitVoxelType(static_cast<VoxelType>(seed % kVoxelTypeCount), [&](auto tag) {
      runVolume<typename decltype(tag)::Type>(seed, rows, folder, coverage);
    });
  }
  std::printf(
      "%d queries: %d with triangles, %d with transition fans, %d with several levels, of them %d "
      "with a curvature tolerance, %d with a view, %d with several choices\n",
      coverage.queries, coverage.with_triangles, coverage.with_transitions,
      coverage.with_two_levels, coverage.flattened, coverage.seen, coverage.combined);
  return coverage;
}

TEST(ExtractProperty, MatchesTheReferenceOnRandomQueries) {
  const SeenCases coverage = runVolumes(repetitions(350), Rows::kOneWord);
  if (HasFatalFailure()) return;
  EXPECT_GT(coverage.with_triangles, coverage.queries * 7 / 10);
  EXPECT_GT(coverage.with_transitions, coverage.queries / 4);
  EXPECT_GT(coverage.flattened, coverage.queries / 10);
  EXPECT_GT(coverage.seen, coverage.queries / 20);
  EXPECT_GT(coverage.combined, coverage.queries / 20);
}

TEST(ExtractProperty, MatchesTheReferenceOnRowsOfSeveralWords) {
  const SeenCases coverage = runVolumes(repetitions(200), Rows::kSeveralWords);
  if (HasFatalFailure()) return;
  EXPECT_GT(coverage.with_triangles, coverage.queries * 7 / 10);
  EXPECT_GT(coverage.with_transitions, coverage.queries / 4);
  EXPECT_GT(coverage.with_two_levels, coverage.queries / 4);
}

// Few values, so that many crossings are in the middle of an edge between leaves of two levels,
// where the finer ones have a corner (rule 8).
TEST(ExtractProperty, CrossingsInTheMiddleOfSharedEdges) {
  const TemporaryFolder folder;
  int with_fans = 0;
  for (int v = 0; v < repetitions(400); ++v) {
    RandomCase random(static_cast<std::uint32_t>(v));
    const Index3 dims(random.uniform(4, 12), random.uniform(4, 12), random.uniform(4, 12));
    std::vector<std::uint8_t> values(static_cast<std::size_t>(dims.x * dims.y * dims.z));
    for (std::uint8_t& value : values) value = static_cast<std::uint8_t>(random.uniform(0, 2) * 2);
    ArraySource<std::uint8_t> source(dims, values);
    const std::string path = folder.file("case.isb");
    BuildOptions options;
    options.filter = format::Filter::kSubsample;
    buildPyramid(source, path, options);
    const Pyramid pyramid(path);
    Query query;
    query.isovalue = random.uniform(1, 3);
    query.focus =
        FocusSphere{glm::dvec3(random.real(0, 12), random.real(0, 12), random.real(0, 12)), 0};
    IndexedMeshSink sink;
    const ExtractionReport report = extractIsosurface(pyramid, query, sink);
    for (const LevelCounts& level : report.levels) with_fans += level.transition_cells > 0 ? 1 : 0;
    ASSERT_TRUE(crossingTriangles(sink.mesh().positions, sink.mesh().triangles).empty())
        << "volume " << v;
  }
  EXPECT_GT(with_fans, repetitions(400) / 2);
}

}  // namespace
}  // namespace isobrick::test
