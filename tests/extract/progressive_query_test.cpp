// Progressive queries: from any state of what is resident a closed, balanced surface without a
// read, which grows to what the query gives. ISOBRICK_PROPERTY_SEED as in
// extract_property_test.cpp; three queries a volume, each in several states.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/oracles/leaf_classifier.h"
#include "isobrick/extract/oracles/residency_oracle.h"
#include "isobrick/extract/paging/brick_fetcher.h"
#include "isobrick/extract/paging/missing_bricks.h"
#include "isobrick/extract/paging/read_ahead.h"
#include "isobrick/extract/session/brick_traversal.h"
#include "isobrick/extract/sinks/indexed_mesh.h"
#include "isobrick/extract/sinks/vertex_numbering.h"
#include "isobrick/preprocess/phantoms/phantom.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/storage/brick_index.h"
#include "isobrick/storage/pyramid_parts.h"
#include "tests/extract/random_case.h"
#include "tests/extract/read_faults.h"
#include "tests/extract/same_mesh.h"
#include "tests/support/array_source.h"
#include "tests/support/every_brick.h"
#include "tests/support/mesh_checker.h"
#include "tests/support/repetitions.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

using std::chrono::milliseconds;

// Counts of what the random states really exercised.
struct ProgressiveCoverage {
  int answers = 0, partial = 0, complete = 0, with_levels = 0, with_transitions = 0, rounds = 0;
};

bool isOneBrick(const Pyramid& pyramid, int level) {
  return elementCount(pyramid.layout().bricks(level)) == 1;
}

// Brings in parts by chance: levels of one brick whole, of a finer one each part with a
// probability of its own.
void bringIn(const Pyramid& pyramid, RandomCase& random) {
  std::vector<double> chances;
  for (int level = 0; level < pyramid.lattice().levels(); ++level)
    chances.push_back(isOneBrick(pyramid, level) || random.chance(0.4) ? 1 : random.real(0.3, 1));
  forAllBricks(pyramid, [&](int level, const Index3& brick) {
    for (const PartKind kind : kPartKinds)
      if (random.chance(chances[static_cast<std::size_t>(level)])) {
        EXPECT_NE(pyramid.parts().fetch(kind, level, brick), BrickPager::Fetched::kNever);
      }
  });
}

void bringAllIn(const Pyramid& pyramid) {
  forAllBricks(pyramid, [&](int level, const Index3& brick) {
    for (const PartKind kind : kPartKinds)
      static_cast<void>(pyramid.parts().fetch(kind, level, brick));
  });
}

LeafLevels leavesNow(const Pyramid& pyramid, const Query& query) {
  ResidencyOracle residency(QueryNeeds(pyramid, query));
  const auto oracles = oraclesOf(pyramid, query);
  const WorldFrame frame(pyramid.spec().geometry);
  ReadLog log;
  const MeshContext context{pyramid, query, oracles,   frame, static_cast<float>(query.isovalue),
                            log,     0,     &residency};
  LeafClassifier classifier(context);
  LeafLevels leaves;
  leaves.cells = pyramid.lattice().cells(0);
  forEachIndex({Index3(0), leaves.cells}, [&](const Index3& cell) {
    int level = 0;
    while (classifier.state(level, cell / (std::int64_t{1} << level)) != CellState::kLeaf) ++level;
    leaves.levels.push_back(static_cast<std::int8_t>(level));
  });
  return leaves;
}

void expectSameBytes(const IndexedMesh& a, const IndexedMesh& b) {
  ASSERT_EQ(a.positions, b.positions);
  ASSERT_EQ(a.normals, b.normals);
  ASSERT_EQ(a.triangles, b.triangles);
}

class ProgressiveQueries {
 public:
  ProgressiveQueries(RandomCase& random, const std::string& path, const ReferencePyramid& reference,
                     ProgressiveCoverage& coverage)
      : random_(random), path_(path), reference_(reference), coverage_(coverage) {}

  void run(Query query) {
    IndexedMeshSink whole;
    extractIsosurface(Pyramid(path_), query, whole);
    query.is_progressive = true;
    for (int state = 0; state < 3; ++state) {
      answerOnce(query, whole.mesh());
      if (testing::Test::HasFatalFailure()) return;
    }
    converge(query, whole.mesh());
  }

 private:
  // With caps at the border of the volume too.
  static void expectClosed(const Pyramid& pyramid, const Query& query, const IndexedMesh& mesh) {
    const MeshCheckOptions options =
        query.cap ? MeshCheckOptions() : indexOptions(pyramid.spec().voxels);
    const MeshReport check = checkMesh(mesh.positions, mesh.triangles, options);
    ASSERT_TRUE(check.ok()) << check.summary();
  }

  void answerOnce(const Query& query, const IndexedMesh& whole) {
    const Pyramid pyramid(path_);
    bringIn(pyramid, random_);
    const LeafLevels leaves = leavesNow(pyramid, query);
    ASSERT_TRUE(auditLeafLevels(leaves).empty());
    const BrickPager::Counters before = pyramid.parts().counters();
    Extractor extractor(pyramid);
    IndexedMeshSink sink;
    const ExtractionReport report = extractor.extract(query, sink);
    expectClosed(pyramid, query, sink.mesh());
    if (testing::Test::HasFatalFailure()) return;
    EXPECT_EQ(pyramid.parts().counters().misses, before.misses) << "something was read";
    const ReferenceMesh reference = referenceMesh(reference_, leaves, query.isovalue);
    ReferenceCaps caps;
    if (query.cap)
      caps = referenceCaps(reference_, leaves, query.isovalue, Index3(0),
                           pyramid.spec().voxels - Index3(1));
    expectSameMesh(sink.mesh(), reference, report, caps);
    if (report.is_complete) expectSameBytes(sink.mesh(), whole);
    ++coverage_.answers;
    ++(report.is_complete ? coverage_.complete : coverage_.partial);
    coverage_.with_levels += !report.is_complete && report.levels.size() > 1 ? 1 : 0;
    coverage_.with_transitions += reference.transitionCellCount() > 0 ? 1 : 0;
  }

  // From nothing, into a mesh in memory too.
  void converge(const Query& query, const IndexedMesh& whole) {
    const Pyramid pyramid(path_);
    Extractor extractor(pyramid);
    for (int round = 0; round < 1000; ++round) {
      IndexedMeshSink sink;
      const ExtractionReport report = extractor.extract(query, sink);
      expectClosed(pyramid, query, sink.mesh());
      if (testing::Test::HasFatalFailure()) return;
      ++coverage_.rounds;
      if (report.is_complete) {
        expectSameBytes(sink.mesh(), whole);
        SurfaceMesh mesh;
        EXPECT_TRUE(extractor.extract(query, mesh).is_complete);
        EXPECT_EQ(mesh.triangles().size(), whole.triangles.size());
        return;
      }
      ASSERT_TRUE(extractor.waitForBricks(milliseconds(random_.uniform(0, 1))))
          << "nothing comes in, and the answer is not complete";
    }
    FAIL() << "the answer never got complete";
  }

  RandomCase& random_;
  const std::string path_;
  const ReferencePyramid& reference_;
  ProgressiveCoverage& coverage_;
};

template <typename T>
void runVolume(std::uint32_t seed, const TemporaryFolder& folder, ProgressiveCoverage& coverage) {
  RandomCase random(seed);
  const Index3 dims = random.dims();
  const std::vector<T> values = random.field<T>(dims);
  BuildOptions options;
  options.brick_cells = std::int64_t{4} << random.uniform(0, 1);
  options.tile_cells = std::min(options.brick_cells, std::int64_t{2} << random.uniform(0, 2));
  options.codec = random.chance(0.5) ? format::Codec::kStored : format::Codec::kLz4;
  ArraySource<T> source(dims, values);
  const std::string path = folder.file("case.isb");
  buildPyramid(source, path, options);
  const ReferencePyramid reference =
      buildReferencePyramid<T>(dims, values, ReferenceFilter::kAverage);
  ProgressiveQueries queries(random, path, reference, coverage);
  for (int q = 0; q < 3; ++q) {
    SCOPED_TRACE("seed " + std::to_string(seed) + " query " + std::to_string(q) + " dims " +
                 std::to_string(dims.x) + "x" + std::to_string(dims.y) + "x" +
                 std::to_string(dims.z) + " brick " + std::to_string(options.brick_cells) +
                 " tile " + std::to_string(options.tile_cells));
    const Pyramid pyramid(path);
    Query query;
    query.isovalue = static_cast<double>(
        values[static_cast<std::size_t>(random.uniform(0, static_cast<int>(values.size()) - 1))]);
    static_cast<DetailChoice&>(query) = randomChoice(random, pyramid, 0.85);
    if (random.chance(0.25)) query.or_finer.push_back(randomChoice(random, pyramid, 1));
    query.cull_by_ranges = random.chance(0.9);
    query.cap = (seed + static_cast<std::uint32_t>(q)) % 3 == 0;
    queries.run(query);
    if (testing::Test::HasFatalFailure()) return;
  }
}

TEST(ProgressiveQuery, AnyStateGivesAClosedSurfaceAndGrowsToTheWholeAnswer) {
  const int volumes = repetitions(60);
  const int first = environmentOr("ISOBRICK_PROPERTY_SEED", 1);
  const TemporaryFolder folder;
  ProgressiveCoverage coverage;
  for (int v = 0; v < volumes; ++v) {
    const auto seed = static_cast<std::uint32_t>(first + v);
    switch (seed % 3) {
      case 0:
        runVolume<std::uint8_t>(seed, folder, coverage);
        break;
      case 1:
        runVolume<std::int16_t>(seed, folder, coverage);
        break;
      default:
        runVolume<float>(seed, folder, coverage);
    }
    if (HasFatalFailure()) return;
  }
  std::printf(
      "%d answers: %d complete, %d not, of these %d of several levels; %d with fans; "
      "%d rounds\n",
      coverage.answers, coverage.complete, coverage.partial, coverage.with_levels,
      coverage.with_transitions, coverage.rounds);
  EXPECT_GT(coverage.complete, coverage.answers / 20);
  EXPECT_GT(coverage.partial, coverage.answers / 3);
  EXPECT_GT(coverage.with_levels, coverage.answers / 8);
}

// Random volumes and budgets, and callers that wait, that do not, that ask for another surface now
// and then, or that cancel: nothing that a run of equal queries fetched goes for it, answers never
// grow coarser, and they end, complete if the budget has room for all.
class AnyBudget {
 public:
  AnyBudget(std::uint32_t seed, const TemporaryFolder& folder)
      : random_(seed), path_(folder.file("budget.isb")) {
    const Index3 dims(random_.uniform(20, 60), random_.uniform(20, 60), random_.uniform(9, 40));
    const std::vector<std::uint8_t> values = random_.field<std::uint8_t>(dims);
    BuildOptions options;
    options.brick_cells = std::int64_t{4} << random_.uniform(0, 1);
    options.codec = random_.chance(0.5) ? format::Codec::kStored : format::Codec::kLz4;
    ArraySource<std::uint8_t> source(dims, values);
    buildPyramid(source, path_, options);
    access_ = random_.chance(0.5) ? FileAccess::kMap : FileAccess::kRead;
    isovalue_ = values[values.size() / 2];
  }

  int answers() const { return answers_; }

  void run() {
    const Pyramid whole(path_, Pyramid::kDefaultBudgetBytes, access_);
    const Query query = randomQuery(whole);
    Extractor of_whole(whole);
    EXPECT_TRUE(refine(of_whole, whole, query, true));
    // Room for all means room for one brick more while it comes in, which is far less than this.
    constexpr std::uint64_t kBrickBytes = std::uint64_t{1} << 16;
    const double share = random_.real(0, 2.2);
    const std::uint64_t budget_bytes =
        static_cast<std::uint64_t>(share * static_cast<double>(whole.parts().heldBytes())) +
        (share > 1 ? kBrickBytes : 0);
    const Pyramid pyramid(path_, budget_bytes, access_);
    Extractor extractor(pyramid);
    const bool wanders = random_.chance(0.5);
    if (wanders) wander(extractor, pyramid);
    const bool is_complete = refine(extractor, pyramid, query, !wanders);
    EXPECT_TRUE(is_complete || share <= 1);
  }

 private:
  Query randomQuery(const Pyramid& pyramid) {
    Query query;
    query.isovalue = isovalue_;
    static_cast<DetailChoice&>(query) = randomChoice(random_, pyramid, 0.85);
    query.is_progressive = true;
    return query;
  }

  void wander(Extractor& extractor, const Pyramid& pyramid) {
    for (int step = random_.uniform(1, 6); step > 0; --step) {
      Query query = randomQuery(pyramid);
      CancelFlag cancel;
      query.cancel = &cancel;
      if (random_.chance(0.2)) cancel.request();
      CountingSink sink;
      try {
        extractor.extract(query, sink);
      } catch (const Cancelled&) {
      }
      if (random_.chance(0.5)) extractor.waitForBricks(milliseconds(random_.uniform(0, 2)));
    }
  }

  // `is_alone`: nobody has asked for another surface of the pyramid.
  bool refine(Extractor& extractor, const Pyramid& pyramid, const Query& query, bool is_alone) {
    const bool waits = random_.chance(0.7);
    std::vector<std::int8_t> before;
    for (int answer = 0;; ++answer) {
      CountingSink sink;
      const ExtractionReport report = extractor.extract(query, sink);
      ++answers_;
      // Unless the levels that are one brick, which are read, take more than the budget.
      const std::uint64_t released = pyramid.parts().counters().parts_released;
      if (answer == 0) is_alone = is_alone && released == 0;
      EXPECT_TRUE(!is_alone || released == 0) << released;
      const std::vector<std::int8_t> leaves = leavesNow(pyramid, query).levels;
      for (std::size_t cell = 0; cell < before.size(); ++cell)
        if (leaves[cell] > before[cell]) {
          ADD_FAILURE() << "coarser than before";
          return false;
        }
      before = leaves;
      if (report.is_complete) return true;
      if (!extractor.waitForBricks(waits ? std::chrono::nanoseconds::max() : milliseconds(0)))
        return false;
      if (answer > 20000) {
        ADD_FAILURE() << "it never ends";
        return false;
      }
    }
  }

  RandomCase random_;
  const std::string path_;
  FileAccess access_ = FileAccess::kMap;
  double isovalue_ = 0;
  int answers_ = 0;
};

TEST(ProgressiveQuery, AnyBudgetAndCallerEndsAndNothingGoesThatWasFetched) {
  const int volumes = repetitions(15);
  const int first = environmentOr("ISOBRICK_PROPERTY_SEED", 1);
  const TemporaryFolder folder;
  int answers = 0;
  for (int v = 0; v < volumes && !HasFailure(); ++v) {
    SCOPED_TRACE("seed " + std::to_string(first + v));
    AnyBudget caller(static_cast<std::uint32_t>(first + v), folder);
    for (int q = 0; q < 3 && !HasFailure(); ++q) caller.run();
    answers += caller.answers();
  }
  std::printf("%d answers\n", answers);
  EXPECT_GT(answers, 3 * volumes);
}

// The head phantom in many bricks, and a focus in it.
class ProgressiveQueryOfAHead : public testing::TestWithParam<format::Codec> {
 protected:
  void SetUp() override {
    BuildOptions options;
    options.brick_cells = 8;
    options.codec = GetParam();
    buildPyramid(*makePhantomSource(PhantomSpec{"head", 100, {}, 16}), path_, options);
    query_.isovalue = 500;
    query_.focus = FocusSphere{glm::dvec3(50, 50, 14), 14};
    query_.is_progressive = true;
  }
  static std::uint64_t trianglesOf(const Pyramid& pyramid, Query query) {
    query.is_progressive = false;
    IndexedMeshSink sink;
    return extractIsosurface(pyramid, query, sink).triangles;
  }
  // Answers until nothing more comes in; the last one.
  ExtractionReport refine(Extractor& extractor,
                          milliseconds between = std::chrono::seconds(10)) const {
    while (true) {
      IndexedMeshSink sink;
      const ExtractionReport report = extractor.extract(query_, sink);
      const MeshReport check =
          checkMesh(sink.mesh().positions, sink.mesh().triangles, indexOptions(Index3(100)));
      EXPECT_TRUE(check.ok()) << check.summary();
      if (report.is_complete || !extractor.waitForBricks(between)) return report;
    }
  }

  // But for the part that each thread is at.
  static void expectNoMoreFetched(const Pyramid& pyramid, std::uint64_t fetched) {
    std::this_thread::sleep_for(milliseconds(20));
    EXPECT_LE(pyramid.parts().counters().parts_fetched, fetched + ReadAhead::kThreads);
  }

  const TemporaryFolder folder_;
  const std::string path_ = folder_.file("head.isb");
  Query query_;
};

TEST_P(ProgressiveQueryOfAHead, TheFirstAnswerReadsOnlyLevelsOfOneBrick) {
  const Pyramid pyramid(path_);
  IndexedMeshSink sink;
  const ExtractionReport report = Extractor(pyramid).extract(query_, sink);
  EXPECT_FALSE(report.is_complete);
  ASSERT_EQ(report.levels.size(), 1u);
  EXPECT_EQ(report.levels[0].level, 4);  // the finest of them: 7 cells of 100
  EXPECT_GT(report.triangles, 0u);
  EXPECT_LE(pyramid.parts().counters().misses,
            2u * 4);  // ranges and samples of the levels from 4 on
}

// Parts of the brick at the focus are used before those of far bricks have come in.
TEST_P(ProgressiveQueryOfAHead, RefinesNearTheFocusFirst) {
  const Pyramid whole(path_);
  const std::uint64_t triangles = trianglesOf(whole, query_);
  // With room for all, all comes in.
  const Pyramid larger(path_, 2 * whole.parts().heldBytes());
  Extractor of_larger(larger);
  EXPECT_EQ(refine(of_larger).triangles, triangles);
  // Room for what is near, but not for all.
  const Pyramid pyramid(path_, larger.parts().heldBytes() / 2);
  Extractor extractor(pyramid);
  const ExtractionReport report = refine(extractor);
  EXPECT_FALSE(report.is_complete);
  EXPECT_LT(report.triangles, triangles);
  EXPECT_EQ(report.levels.front().level, 0);
  EXPECT_GT(report.levels.back().level, 1);
}

// All that is fetched counts: else it would push out the coarse bricks that were fetched first and
// that all others need.
TEST_P(ProgressiveQueryOfAHead, WhatIsFetchedFitsIntoTheBudget) {
  const Pyramid whole(path_);
  trianglesOf(whole, query_);
  for (const std::uint64_t quarters : {1, 2, 3})
    // Also what comes in while the next answer is made.
    for (const milliseconds between : {milliseconds(10000), milliseconds(0)}) {
      SCOPED_TRACE(testing::Message() << quarters << " quarters, " << between.count() << " ms");
      const Pyramid pyramid(path_, whole.parts().heldBytes() * quarters / 4);
      Extractor extractor(pyramid);
      EXPECT_FALSE(refine(extractor, between).is_complete);
      EXPECT_EQ(pyramid.parts().counters().parts_released, 0u);
    }
}

// A part that came in and went again before it was used is not waited for anew for ever.
TEST_P(ProgressiveQueryOfAHead, EndsForAnyBudget) {
  const Pyramid whole(path_);
  const std::uint64_t triangles = trianglesOf(whole, query_);
  for (const std::uint64_t sixteenths : {0, 1, 2, 4, 8, 15, 16}) {
    SCOPED_TRACE(sixteenths);
    const Pyramid pyramid(path_, whole.parts().heldBytes() * sixteenths / 16);
    Extractor extractor(pyramid);
    std::size_t answers = 0;
    ExtractionReport report;
    do {
      ASSERT_LE(++answers, pyramid.brickCount());
      IndexedMeshSink sink;
      report = extractor.extract(query_, sink);
      EXPECT_GT(report.triangles, 0u);
    } while (!report.is_complete && extractor.waitForBricks(std::chrono::seconds(10)));
    EXPECT_EQ(trianglesOf(pyramid, query_), triangles);
  }
}

// Parts that another extractor on the pyramid brought in since the query looked have come.
TEST_P(ProgressiveQueryOfAHead, WhatOthersBringInIsWaitedFor) {
  const Pyramid pyramid(path_);
  const QueryNeeds needs(pyramid, query_);
  ResidencyOracle residency(needs);
  const auto oracles = oraclesOf(pyramid, query_);
  const WorldFrame frame(pyramid.spec().geometry);
  ReadLog log;
  const MeshContext context{pyramid, query_, oracles,   frame, static_cast<float>(query_.isovalue),
                            log,     0,      &residency};
  BrickFetcher fetcher;
  fetcher.beginQuery();
  traverseBricks(context);
  const std::vector<MissingBrick> missing = missingBricks(context);
  bringAllIn(pyramid);
  const std::uint64_t fetched = pyramid.parts().counters().parts_fetched;
  fetcher.announce(needs, missing, 0);
  EXPECT_TRUE(fetcher.wait(std::chrono::seconds(10)));
  EXPECT_EQ(pyramid.parts().counters().parts_fetched, fetched);
  // Parts that were there before have not.
  fetcher.beginQuery();
  std::vector<MissingBrick> there = missing;
  for (MissingBrick& brick : there) brick.lacks_parts = brick.needs_samples = false;
  fetcher.announce(needs, there, 0);
  EXPECT_FALSE(fetcher.wait(std::chrono::seconds(10)));
}

TEST_P(ProgressiveQueryOfAHead, TwoExtractorsAtOnceBothRefineToTheEnd) {
  for (int time = 0; time < 4; ++time) {
    const Pyramid pyramid(path_);
    std::array<ExtractionReport, 2> reports;
    const auto refineInto = [&](ExtractionReport& report) {
      Extractor extractor(pyramid);
      report = refine(extractor);
    };
    std::thread other([&] { refineInto(reports[0]); });
    refineInto(reports[1]);
    other.join();
    for (const ExtractionReport& report : reports) EXPECT_TRUE(report.is_complete);
  }
}

TEST_P(ProgressiveQueryOfAHead, OtherQueriesTakeAnnouncementsBack) {
  const Pyramid pyramid(path_);
  Extractor extractor(pyramid);
  IndexedMeshSink sink;
  EXPECT_FALSE(extractor.extract(query_, sink).is_complete);
  Query other = query_;
  other.is_progressive = false;
  other.uniform_level = 4;
  other.focus.reset();
  IndexedMeshSink others;
  extractor.extract(other, others);
  const std::uint64_t fetched = pyramid.parts().counters().parts_fetched;
  expectNoMoreFetched(pyramid, fetched);
}

TEST_P(ProgressiveQueryOfAHead, ACancelledOneReadsNoFurther) {
  const Pyramid pyramid(path_);
  Extractor extractor(pyramid);
  IndexedMeshSink sink;
  EXPECT_FALSE(extractor.extract(query_, sink).is_complete);
  CancelFlag cancel;
  cancel.request();
  Query cancelled = query_;
  cancelled.cancel = &cancel;
  EXPECT_THROW(extractor.extract(cancelled, sink), Cancelled);
  const std::uint64_t fetched = pyramid.parts().counters().parts_fetched;
  expectNoMoreFetched(pyramid, fetched);
  EXPECT_TRUE(refine(extractor).is_complete);
}

TEST_P(ProgressiveQueryOfAHead, ABrickThatCannotBeHadIsAnError) {
  const Pyramid pyramid(path_, Pyramid::kDefaultBudgetBytes, FileAccess::kRead);
  Extractor extractor(pyramid);
  IndexedMeshSink first;
  // The levels of one brick lie behind all others.
  const auto half = std::filesystem::file_size(path_) / 2;
  {
    const FaultyReads fault(path_, ReadFault::kIoError, 0, half);
    EXPECT_FALSE(extractor.extract(query_, first).is_complete);
    extractor.waitForBricks(std::chrono::seconds(10));
    try {
      refine(extractor);
      ADD_FAILURE() << "nothing was wrong";
    } catch (const Error& error) {
      EXPECT_NE(std::string(error.what()).find("brick ("), std::string::npos) << error.what();
      EXPECT_TRUE(error.place().offset);
    }
  }
  EXPECT_TRUE(refine(extractor).is_complete);
}

TEST_P(ProgressiveQueryOfAHead, HasNoPlan) {
  const Pyramid pyramid(path_);
  EXPECT_THROW(Extractor(pyramid).plan(query_), Error);
}

// A file whose brick table is too long to be read when it is opened: its rows come in as parts do.
TEST(ProgressiveQuery, ReadsNoRowsWhileItsCallerWaits) {
  const TemporaryFolder folder;
  const std::string path = folder.file("many_bricks.isb");
  BuildOptions options;
  options.brick_cells = 4;
  buildPyramid(*makePhantomSource(PhantomSpec{"head", 100, {}, 16}), path, options);
  const Pyramid pyramid(path);
  ASSERT_GT(pyramid.brickCount() * 96, BrickIndex::kReadAtOnceBytes);
  ASSERT_EQ(pyramid.parts().tableBytesRead(), 0u);
  Query query;
  query.isovalue = 500;
  query.focus = FocusSphere{glm::dvec3(50, 50, 14), 14};
  query.is_progressive = true;
  // The rows of levels that are one brick.
  std::uint64_t of_whole_levels = 0;
  {
    const QueryNeeds needs(pyramid, query);
    ResidencyOracle residency(needs);
    const auto oracles = oraclesOf(pyramid, query);
    const WorldFrame frame(pyramid.spec().geometry);
    ReadLog log;
    const MeshContext context{pyramid, query, oracles,   frame, static_cast<float>(query.isovalue),
                              log,     0,     &residency};
    EXPECT_EQ(traverseBricks(context).size(), 1u);
    EXPECT_FALSE(missingBricks(context).empty());
    of_whole_levels = pyramid.parts().tableBytesRead();
    EXPECT_LE(of_whole_levels, 2u * BrickIndex::kRowsAtATime * 120);
  }
  Extractor extractor(pyramid);
  ExtractionReport report;
  int answers = 0;
  do {
    ASSERT_LT(++answers, 100);
    IndexedMeshSink sink;
    report = extractor.extract(query, sink);
  } while (!report.is_complete && extractor.waitForBricks(std::chrono::nanoseconds::max()));
  EXPECT_TRUE(report.is_complete);
  EXPECT_GT(pyramid.parts().tableBytesRead(), of_whole_levels);
}

// As long as anybody can wait is no time that is over at once.
TEST_P(ProgressiveQueryOfAHead, WaitsForEverIfThatIsAsked) {
  const Pyramid pyramid(path_);
  Extractor extractor(pyramid);
  IndexedMeshSink sink;
  EXPECT_FALSE(extractor.extract(query_, sink).is_complete);
  EXPECT_TRUE(extractor.waitForBricks(std::chrono::nanoseconds::max()));
  const std::uint64_t fetched = pyramid.parts().counters().parts_fetched;
  EXPECT_TRUE(extractor.waitForBricks(std::chrono::nanoseconds::max()));
  EXPECT_EQ(pyramid.parts().counters().parts_fetched, fetched);  // it had waited for all
}

INSTANTIATE_TEST_SUITE_P(All, ProgressiveQueryOfAHead,
                         testing::Values(format::Codec::kStored, format::Codec::kZstd),
                         [](const auto& test) {
                           return std::string(test.param == format::Codec::kStored ? "Stored"
                                                                                   : "Packed");
                         });

}  // namespace
}  // namespace isobrick::test
