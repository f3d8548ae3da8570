// The extractor against the reference mesher over random volumes and random queries (rule 11 in
// every case, the same crossings to the bit, the same triangle counts). ISOBRICK_PROPERTY_VOLUMES
// sets the number of volumes (six queries each), ISOBRICK_PROPERTY_WIDE_VOLUMES that of volumes in
// bricks with rows of several words, ISOBRICK_PROPERTY_SEED the first seed.
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
#include "isobrick/storage/curvature_code.h"
#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/pyramid_parts.h"
#include "tests/extract/random_case.h"
#include "tests/extract/same_mesh.h"
#include "tests/support/array_source.h"
#include "tests/support/mesh_checker.h"
#include "tests/support/reference_error.h"
#include "tests/support/reference_mesher.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

constexpr int kQueriesPerVolume = 6;

// What the random queries really exercised; a generator that drifts to empty meshes is a test that
// cannot fail.
struct Coverage {
  int queries = 0, with_triangles = 0, with_transitions = 0, with_two_levels = 0, flattened = 0,
      seen = 0, combined = 0, tolerated = 0, promised = 0, bounded = 0;
};

// The curvature decision of one cell of level 1, from what the pyramid says of it.
bool isFlatByPyramid(const Pyramid& pyramid, float isovalue, double tolerance, const Index3& cell) {
  const BrickLayout& layout = pyramid.layout();
  const Index3 brick = std::int64_t{2} * cell / layout.brickCells();
  std::vector<ValueRange> ranges;
  std::vector<std::uint8_t> coefficients;
  pyramid.tileRanges(0, brick, ranges);
  pyramid.parts().curvature(brick, coefficients);
  const Index3 local = std::int64_t{2} * cell - brick * layout.brickCells();
  const ValueRange range = ranges[static_cast<std::size_t>(
      linearIndex(local / layout.tileCells(), layout.brickTiles(0, brick)))];
  const auto node =
      static_cast<std::size_t>(linearIndex(local / std::int64_t{2}, layout.brickNodes(brick)));
  return static_cast<double>(
             curvatureBound(&coefficients[3 * node], range.min, range.max, isovalue)) <= tolerance;
}

// The leaves that the fast classifier sees, cell by cell.
void expectSameLeaves(const Pyramid& pyramid, const Query& query, const LeafLevels& expected) {
  const auto oracles = oraclesOf(pyramid, query);
  const WorldFrame frame(pyramid.spec().geometry);
  ReadLog log;
  const MeshContext context{pyramid, query, oracles, frame, static_cast<float>(query.isovalue),
                            log};
  LeafClassifier classifier(context);
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

// The decision of the tolerance. Where single precision may see it otherwise, its own.
bool isBeyond(const Pyramid& pyramid, ReferenceTolerance& reference, float isovalue,
              double tolerance, const Index3& cell) {
  if (const auto refines = reference.refines(cell)) return *refines;
  Query query;
  query.isovalue = static_cast<double>(isovalue);
  query.tolerance = tolerance;
  const auto oracles = oraclesOf(pyramid, query);
  const WorldFrame frame(pyramid.spec().geometry);
  ReadLog log;
  return oracles[0].error->refines({pyramid, query, oracles, frame, isovalue, log}, 1, cell);
}

// The decision of the tolerance on levels that may have stored bounds, for all cells of a level, x
// fastest, by what the pyramid says. The one block of a tile for all bins that it does not touch
// may say more of a cell than a coarser one says that touches it, in a bin of its own; then the
// coarser one is right.
std::vector<std::uint8_t> boundsBeyond(const Pyramid& pyramid, float isovalue, double tolerance,
                                       int level) {
  const Lattice& lattice = pyramid.lattice();
  const Index3 cells = lattice.cells(level);
  std::vector<std::uint8_t> are_beyond(static_cast<std::size_t>(elementCount(cells)), 1);
  const BrickLayout& layout = pyramid.layout();
  std::vector<std::uint8_t> codes;
  forEachIndex({Index3(0), layout.bricks(level)}, [&](const Index3& brick) {
    if (!pyramid.parts().errorCodes(level, brick, static_cast<double>(isovalue), codes)) return;
    const std::uint8_t* code = codes.data();
    forEachIndex(layout.brickCellBox(level, brick), [&](const Index3& cell) {
      const double bound = ErrorCode::decode(*code++) * pyramid.parts().tables().errorBins().unit();
      are_beyond[static_cast<std::size_t>(linearIndex(cell, cells))] = bound > tolerance ? 1 : 0;
    });
  });
  if (level >= pyramid.parts().tables().errorBins().last_level || level + 1 >= lattice.levels())
    return are_beyond;
  const std::vector<std::uint8_t> coarser = boundsBeyond(pyramid, isovalue, tolerance, level + 1);
  const Index3 coarser_cells = lattice.cells(level + 1);
  forEachIndex({Index3(0), cells}, [&](const Index3& cell) {
    const Index3 first = glm::max(cell - Index3(1), Index3(0)) / std::int64_t{2};
    const Index3 last = glm::min((cell + Index3(1)) / std::int64_t{2}, coarser_cells - Index3(1));
    forEachIndex({first, last - first + Index3(1)}, [&](const Index3& at) {
      if (coarser[static_cast<std::size_t>(linearIndex(at, coarser_cells))] == 0)
        are_beyond[static_cast<std::size_t>(linearIndex(cell, cells))] = 0;
    });
  });
  return are_beyond;
}

LeafLevels referenceLeaves(const Pyramid& pyramid, const ReferencePyramid& reference,
                           double isovalue, const DetailChoice& choice) {
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
  std::map<int, std::vector<std::uint8_t>> bounds;
  std::optional<ReferenceTolerance> tolerance;
  if (choice.tolerance)
    tolerance.emplace(reference, static_cast<double>(static_cast<float>(isovalue)),
                      *choice.tolerance);
  std::map<std::int64_t, bool> beyond;  // asked for by each cell of level 0 in it
  expected.further = [&, iso = static_cast<float>(isovalue)](int level, const Index3& cell) {
    if (choice.view && !isSeen(*choice.view, level, cell)) return false;
    if (choice.tolerance && level > 1) {
      const Lattice& lattice = pyramid.lattice();
      if (level >= lattice.levels()) return true;
      std::vector<std::uint8_t>& known = bounds[level];
      if (known.empty()) known = boundsBeyond(pyramid, iso, *choice.tolerance, level);
      return known[static_cast<std::size_t>(linearIndex(cell, lattice.cells(level)))] != 0;
    }
    if (!choice.tolerance || level != 1) return true;
    const auto [known, is_new] =
        beyond.try_emplace(linearIndex(cell, pyramid.lattice().cells(1)), false);
    if (is_new) known->second = isBeyond(pyramid, *tolerance, iso, *choice.tolerance, cell);
    return known->second;
  };
  return referenceLeafLevels(pyramid.lattice(), expected);
}

// Bricks of up to 64 cells, whose rows of bits are one word, or rows of two to four words.
enum class Rows { kOneWord, kSeveralWords };

template <typename T>
void runVolume(std::uint32_t seed, Rows rows, const TemporaryFolder& folder, Coverage& coverage) {
  RandomCase random(seed);
  const bool is_wide = rows == Rows::kSeveralWords;
  const Index3 dims = is_wide ? random.wideDims() : random.dims();
  const std::vector<T> values = random.field<T>(dims);
  BuildOptions options;
  options.brick_cells =
      is_wide ? std::int64_t{128} << random.uniform(0, 1) : std::int64_t{4} << random.uniform(0, 4);
  options.tile_cells = std::min(options.brick_cells, std::int64_t{2} << random.uniform(0, 2));
  options.error_level = random.chance(0.3) ? 0 : random.uniform(2, 3);
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
    LeafLevels leaves = referenceLeaves(pyramid, reference_pyramid, query.isovalue, query);
    if (random.chance(0.25))
      for (int further = random.uniform(1, 2); further > 0; --further) {
        query.or_finer.push_back(randomChoice(random, pyramid, 1));
        leaves = finerLeafLevels(leaves, referenceLeaves(pyramid, reference_pyramid, query.isovalue,
                                                         query.or_finer.back()));
      }
    IndexedMeshSink sink;
    const ExtractionReport report = extractIsosurface(pyramid, query, sink);
    const MeshReport check =
        checkMesh(sink.mesh().positions, sink.mesh().triangles, indexOptions(dims));
    ASSERT_TRUE(check.ok()) << check.summary();
    const ReferenceMesh reference = referenceMesh(reference_pyramid, leaves, query.isovalue);
    expectSameMesh(sink.mesh(), reference, report);
    if (testing::Test::HasFatalFailure()) return;
    ASSERT_TRUE(auditLeafLevels(reference.leaves).empty());
    expectSameLeaves(pyramid, query, reference.leaves);
    if (testing::Test::HasFatalFailure()) return;

    if (query.tolerance && !query.view && !query.focus && !query.curvature_tolerance) {
      ASSERT_EQ(
          brokenPromise(reference_pyramid, reference,
                        static_cast<double>(static_cast<float>(query.isovalue)), *query.tolerance),
          "");
      coverage.promised += report.levels.size() > 1 ? 1 : 0;
      coverage.bounded += !report.levels.empty() && report.levels.back().level > 1 ? 1 : 0;
    }

    ++coverage.queries;
    coverage.tolerated += query.tolerance && report.levels.size() > 1 ? 1 : 0;
    coverage.with_triangles += report.triangles > 0 ? 1 : 0;
    coverage.with_transitions += reference.transitionCellCount() > 0 ? 1 : 0;
    coverage.with_two_levels += report.levels.size() > 1 ? 1 : 0;
    coverage.flattened += query.curvature_tolerance && report.levels.size() > 1 ? 1 : 0;
    coverage.seen += query.view && report.levels.size() > 1 ? 1 : 0;
    coverage.combined += !query.or_finer.empty() && report.levels.size() > 1 ? 1 : 0;

    query.cull_by_ranges = false;
    IndexedMeshSink unculled;
    extractIsosurface(pyramid, query, unculled);
    ASSERT_EQ(unculled.mesh().positions, sink.mesh().positions);
    ASSERT_EQ(unculled.mesh().triangles, sink.mesh().triangles);
  }
}

Coverage runVolumes(int volumes, Rows rows) {
  const TemporaryFolder folder;
  const int first = environmentOr("ISOBRICK_PROPERTY_SEED", 1);
  Coverage coverage;
  for (int v = 0; v < volumes && !testing::Test::HasFatalFailure(); ++v) {
    const auto seed = static_cast<std::uint32_t>(first + v);
    visitVoxelType(static_cast<VoxelType>(seed % kVoxelTypeCount), [&](auto tag) {
      runVolume<typename decltype(tag)::Type>(seed, rows, folder, coverage);
    });
  }
  std::printf(
      "%d queries: %d with triangles, %d with transition fans, %d with several levels, of them %d "
      "with a curvature tolerance, %d with a view, %d with several choices, %d with a tolerance, "
      "%d "
      "with nothing else, %d of these with leaves of level 2 or 3\n",
      coverage.queries, coverage.with_triangles, coverage.with_transitions,
      coverage.with_two_levels, coverage.flattened, coverage.seen, coverage.combined,
      coverage.tolerated, coverage.promised, coverage.bounded);
  return coverage;
}

TEST(ExtractProperty, MatchesTheReferenceOnRandomQueries) {
  const Coverage coverage =
      runVolumes(environmentOr("ISOBRICK_PROPERTY_VOLUMES", 350), Rows::kOneWord);
  if (HasFatalFailure()) return;
  EXPECT_GT(coverage.with_triangles, coverage.queries * 7 / 10);
  EXPECT_GT(coverage.with_transitions, coverage.queries / 4);
  EXPECT_GT(coverage.flattened, coverage.queries / 10);
  EXPECT_GT(coverage.seen, coverage.queries / 20);
  EXPECT_GT(coverage.combined, coverage.queries / 20);
  EXPECT_GT(coverage.promised, coverage.queries / 30);
  EXPECT_GT(coverage.bounded, coverage.queries / 100);
}

TEST(ExtractProperty, MatchesTheReferenceOnRowsOfSeveralWords) {
  const Coverage coverage =
      runVolumes(environmentOr("ISOBRICK_PROPERTY_WIDE_VOLUMES", 200), Rows::kSeveralWords);
  if (HasFatalFailure()) return;
  EXPECT_GT(coverage.with_triangles, coverage.queries * 7 / 10);
  EXPECT_GT(coverage.with_transitions, coverage.queries / 4);
  EXPECT_GT(coverage.with_two_levels, coverage.queries / 4);
}

}  // namespace
}  // namespace isobrick::test
