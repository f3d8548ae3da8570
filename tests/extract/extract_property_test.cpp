// The extractor against the reference mesher over random volumes and random queries (rule 11 in
// every case, the same crossings to the bit, the same triangle counts). ISOBRICK_PROPERTY_VOLUMES
// sets the number of volumes (six queries each), ISOBRICK_PROPERTY_SEED the first seed.
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
      seen = 0, combined = 0, tolerated = 0, promised = 0;
};

int environmentOr(const char* name, int otherwise) {
  const char* text = std::getenv(name);
  return text != nullptr ? std::atoi(text) : otherwise;
}

class RandomCase {
 public:
  explicit RandomCase(std::uint32_t seed) : random_(seed) {}

  int uniform(int low, int high) { return std::uniform_int_distribution<int>(low, high)(random_); }
  double real(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }
  bool chance(double p) { return real(0, 1) < p; }

  Index3 dims() {
    // Mostly small, so that borders and thin cells are everywhere; now and then up to 70.
    const int most = chance(0.1) ? 70 : chance(0.4) ? 34 : 14;
    Index3 d(uniform(2, most), uniform(2, most), uniform(2, most));
    while (elementCount(d) > 40000) d[uniform(0, 2)] = uniform(2, 20);
    return d;
  }

  // Noise, plateaus, smooth bumps with or without noise, or nearly linear.
  template <typename T>
  std::vector<T> field(const Index3& dims) {
    const int kind = uniform(0, 4);
    const double low = std::is_signed_v<T> && !std::is_floating_point_v<T> ? -100.0 : 0.0;
    const glm::dvec3 wave(real(0.1, 0.9), real(0.1, 0.9), real(0.1, 0.9));
    const double phase = real(0, 6), noise = chance(0.5) ? real(0, 20) : 0.0;
    const int steps = uniform(2, 5);
    std::vector<T> values;
    for (std::int64_t z = 0; z < dims.z; ++z)
      for (std::int64_t y = 0; y < dims.y; ++y)
        for (std::int64_t x = 0; x < dims.x; ++x) {
          const double smooth = 0.5 + (std::sin(wave.x * static_cast<double>(x) + phase) +
                                       std::sin(wave.y * static_cast<double>(y)) +
                                       std::sin(wave.z * static_cast<double>(z) - phase)) /
                                          6;
          double v = 0;
          switch (kind) {
            case 0:
              v = real(0, 200);
              break;
            case 1:
              v = 50 * uniform(0, steps - 1);
              break;
            case 2:
              v = 200 * smooth + real(-noise, noise);
              break;
            case 3:
              v = std::floor(smooth * steps) * 40;
              break;
            default:
              v = 2 * wave.x * static_cast<double>(x) + wave.y * static_cast<double>(y) +
                  wave.z * static_cast<double>(z) + real(-noise, noise) * 0.1;
          }
          v = std::clamp(low + v, low, low + 200);
          values.push_back(static_cast<T>(std::is_floating_point_v<T> ? v : std::round(v)));
        }
    return values;
  }

 private:
  std::mt19937 random_;
};

// The curvature decision of one cell of level 1, from what the pyramid says of it.
bool isFlatByPyramid(const Pyramid& pyramid, float isovalue, double tolerance, const Index3& cell) {
  const BrickLayout& layout = pyramid.layout();
  const Index3 brick = std::int64_t{2} * cell / layout.brickCells();
  std::vector<ValueRange> ranges;
  std::vector<std::uint8_t> coefficients;
  pyramid.tileRanges(0, brick, ranges);
  pyramid.curvature(brick, coefficients);
  const Index3 local = std::int64_t{2} * cell - brick * layout.brickCells();
  const ValueRange range = ranges[static_cast<std::size_t>(
      linearIndex(local / layout.tileCells(), layout.brickTiles(0, brick)))];
  const auto node =
      static_cast<std::size_t>(linearIndex(local / std::int64_t{2}, layout.brickNodes(brick)));
  return static_cast<double>(
             curvatureBound(&coefficients[3 * node], range.min, range.max, isovalue)) <= tolerance;
}

using Point = std::tuple<double, double, double>;
Point pointOf(const glm::dvec3& p) { return {p.x, p.y, p.z}; }

void expectSameMesh(const IndexedMesh& mesh, const ReferenceMesh& reference,
                    const ExtractionReport& report) {
  ASSERT_EQ(mesh.triangles.size() / 3, static_cast<std::size_t>(reference.triangleCount()));
  ASSERT_EQ(mesh.positions.size(), reference.positions.size());
  std::map<Point, std::uint32_t> vertex_at;
  for (std::uint32_t v = 0; v < mesh.positions.size(); ++v)
    vertex_at.emplace(pointOf(mesh.positions[v]), v);
  std::vector<std::uint32_t> vertex_of_crossing;
  for (const ReferenceCrossing& crossing : reference.crossings) {
    const auto found = vertex_at.find(pointOf(crossing.point()));
    ASSERT_NE(found, vertex_at.end()) << "a crossing of the reference is missing";
    vertex_of_crossing.push_back(found->second);
    ASSERT_EQ(glm::dvec3(mesh.normals[found->second]), crossing.normal) << "normals differ";
  }
  // The contours on all cell faces, direction included.
  std::set<std::pair<std::uint32_t, std::uint32_t>> edges;
  for (std::size_t t = 0; t < mesh.triangles.size(); t += 3)
    for (std::size_t i = 0; i < 3; ++i)
      edges.emplace(mesh.triangles[t + i], mesh.triangles[t + (i + 1) % 3]);
  for (const auto& segment : reference.segments)
    ASSERT_TRUE(edges.count({vertex_of_crossing[segment[0]], vertex_of_crossing[segment[1]]}) == 1)
        << "a piece of a contour is missing";
  std::uint64_t triangles = 0;
  for (const LevelCounts& counts : report.levels) {
    const ReferenceLevelCounts& expected =
        reference.level_counts[static_cast<std::size_t>(counts.level)];
    EXPECT_EQ(counts.cells, static_cast<std::uint64_t>(expected.cells));
    EXPECT_EQ(counts.transition_cells, static_cast<std::uint64_t>(expected.transition_cells));
    EXPECT_EQ(counts.triangles, static_cast<std::uint64_t>(expected.triangles));
    triangles += counts.triangles;
  }
  EXPECT_EQ(report.triangles, triangles);
}

// The leaves that the fast classifier sees, cell by cell.
void expectSameLeaves(const Pyramid& pyramid, const Query& query, const LeafLevels& expected) {
  const auto oracles =
      oraclesOf(pyramid.lattice(), pyramid.spec().geometry, pyramid.valueRange(), query);
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

DetailChoice randomChoice(RandomCase& random, const Pyramid& pyramid, double focused) {
  const Index3& dims = pyramid.spec().voxels;
  const auto reach = static_cast<double>(std::max({dims.x, dims.y, dims.z}));
  const auto anywhere = [&] {
    glm::dvec3 point;
    for (int axis = 0; axis < 3; ++axis)
      point[axis] = random.chance(0.8) ? random.real(0, static_cast<double>(dims[axis] - 1))
                                       : random.real(-reach, 2 * reach);
    return random.chance(0.3) ? glm::round(point) : point;
  };
  DetailChoice choice;
  const auto tolerance = [&] { return random.chance(0.1) ? 0.0 : random.real(0, 120); };
  if (random.chance(0.15)) {
    choice.tolerance = tolerance();
    return choice;
  }
  if (random.chance(0.25)) {
    ViewPoint& view = choice.view.emplace();
    view.eye = anywhere();
    view.pixels = random.real(0.5, 4);
    if (random.chance(0.15))
      view.pixels_per_unit = view.pixels * std::exp2(-random.real(-1, 4));
    else
      view.pixels_per_radian = random.real(1, 40);
    if (random.chance(0.6)) {
      view.field.emplace();
      view.field->direction = anywhere() - view.eye + glm::dvec3(0.01);
      view.field->half_angle = random.real(0.05, 1.5);
      view.field->radius = random.real(0.5, reach);
    }
  }
  if (random.chance(choice.view ? 0.3 : focused)) {
    choice.focus = FocusSphere{anywhere(), 0};
    if (!random.chance(0.25))
      choice.focus->radius = random.real(0, random.chance(0.2) ? 2 * reach : reach / 3);
  } else if (random.chance(0.5)) {
    choice.uniform_level = random.uniform(0, pyramid.lattice().levels() - 1);
  }
  if (choice.uniform_level.value_or(0) == 0 && random.chance(0.6))
    choice.curvature_tolerance = random.chance(0.15) ? 0.0 : std::exp(random.real(-9, 5));
  if (choice.uniform_level.value_or(0) == 0 && random.chance(0.2)) choice.tolerance = tolerance();
  return choice;
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
bool isBeyond(const Pyramid& pyramid, const ReferencePyramid& reference, float isovalue,
              double tolerance, const Index3& cell) {
  const double error = referenceError(reference, static_cast<double>(isovalue), cell);
  if (std::abs(error - tolerance) > 2e-3) return error > tolerance;
  Query query;
  query.isovalue = static_cast<double>(isovalue);
  query.tolerance = tolerance;
  const auto oracles =
      oraclesOf(pyramid.lattice(), pyramid.spec().geometry, pyramid.valueRange(), query);
  const WorldFrame frame(pyramid.spec().geometry);
  ReadLog log;
  return oracles[0].error->refines({pyramid, query, oracles, frame, isovalue, log}, 1, cell);
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
  std::map<std::int64_t, bool> beyond;  // asked for by each cell of level 0 in it
  expected.further = [&, iso = static_cast<float>(isovalue)](int level, const Index3& cell) {
    if (choice.view && !isSeen(*choice.view, level, cell)) return false;
    if (!choice.tolerance || level != 1) return true;
    const auto [known, is_new] =
        beyond.try_emplace(linearIndex(cell, pyramid.lattice().cells(1)), false);
    if (is_new) known->second = isBeyond(pyramid, reference, iso, *choice.tolerance, cell);
    return known->second;
  };
  return referenceLeafLevels(pyramid.lattice(), expected);
}

template <typename T>
void runVolume(std::uint32_t seed, const TemporaryFolder& folder, Coverage& coverage) {
  RandomCase random(seed);
  const Index3 dims = random.dims();
  const std::vector<T> values = random.field<T>(dims);
  BuildOptions options;
  options.brick_cells = std::int64_t{4} << random.uniform(0, 4);
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

TEST(ExtractProperty, MatchesTheReferenceOnRandomQueries) {
  const TemporaryFolder folder;
  const int volumes = environmentOr("ISOBRICK_PROPERTY_VOLUMES", 350);
  const int first = environmentOr("ISOBRICK_PROPERTY_SEED", 1);
  Coverage coverage;
  for (int v = 0; v < volumes; ++v) {
    const auto seed = static_cast<std::uint32_t>(first + v);
    switch (seed % 5) {
      case 0:
        runVolume<std::uint8_t>(seed, folder, coverage);
        break;
      case 1:
        runVolume<std::int8_t>(seed, folder, coverage);
        break;
      case 2:
        runVolume<std::uint16_t>(seed, folder, coverage);
        break;
      case 3:
        runVolume<std::int16_t>(seed, folder, coverage);
        break;
      default:
        runVolume<float>(seed, folder, coverage);
    }
    if (HasFatalFailure()) return;
  }
  std::printf(
      "%d queries: %d with triangles, %d with transition fans, %d with several levels, of them %d "
      "with a curvature tolerance, %d with a view, %d with several choices, %d with a tolerance, "
      "%d "
      "with nothing else\n",
      coverage.queries, coverage.with_triangles, coverage.with_transitions,
      coverage.with_two_levels, coverage.flattened, coverage.seen, coverage.combined,
      coverage.tolerated, coverage.promised);
  EXPECT_GT(coverage.with_triangles, coverage.queries * 7 / 10);
  EXPECT_GT(coverage.with_transitions, coverage.queries / 4);
  EXPECT_GT(coverage.flattened, coverage.queries / 10);
  EXPECT_GT(coverage.seen, coverage.queries / 20);
  EXPECT_GT(coverage.combined, coverage.queries / 20);
  EXPECT_GT(coverage.promised, coverage.queries / 30);
}

}  // namespace
}  // namespace isobrick::test
