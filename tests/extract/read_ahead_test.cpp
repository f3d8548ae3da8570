// Bricks come in ahead of the threads that mesh them, each once, and the mesh is the same.
#include "isobrick/extract/paging/read_ahead.h"

#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <functional>
#include <thread>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/session/mesh_context.h"
#include "isobrick/extract/sinks/vertex_numbering.h"
#include "isobrick/extract/surface_mesh.h"
#include "isobrick/preprocess/phantoms/phantom.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/pyramid_parts.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

using format::Codec;

// Calls something when the fifth brick with triangles has been meshed.
class SinkWithAStop : public CountingSink {
 public:
  explicit SinkWithAStop(std::function<void()> stop) : stop_(std::move(stop)) {}
  void place(PlacedBatch& batch) override {
    CountingSink::place(batch);
    if (++placed_ == 5) stop_();
  }

 private:
  std::function<void()> stop_;
  int placed_ = 0;
};

// Sees how much the pyramid holds while it is read.
class HeldSink : public CountingSink {
 public:
  explicit HeldSink(const Pyramid& pyramid) : pyramid_(pyramid) {}
  void place(PlacedBatch& batch) override {
    CountingSink::place(batch);
    most_held_ = std::max(most_held_, pyramid_.parts().heldBytes());
  }
  std::uint64_t mostHeld() const { return most_held_; }

 private:
  const Pyramid& pyramid_;
  std::uint64_t most_held_ = 0;
};

class ReadAheadTest : public testing::TestWithParam<Codec> {
 protected:
  // Of a file that is not mapped the page cache is not asked: it is read ahead though it is new.
  static constexpr FileAccess kReadAhead = FileAccess::kRead;
  static constexpr std::uint64_t kBudget = Pyramid::kDefaultBudgetBytes;

  void SetUp() override {
    BuildOptions options;
    options.brick_cells = 16;
    options.codec = GetParam();
    buildPyramid(*makePhantomSource(PhantomSpec{"head", 96, {}, 16}), path_, options);
    query_.isovalue = 500;
  }
  // Gives up after a while, so that a test without read-ahead fails rather than hangs.
  static void waitForFetched(const Pyramid& pyramid) {
    for (int n = 0; n < 10000 && pyramid.parts().counters().parts_fetched == 0; ++n)
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  std::uint64_t trianglesOf(const Pyramid& pyramid) const {
    CountingSink sink;
    return extractIsosurface(pyramid, query_, sink).triangles;
  }

  const TemporaryFolder folder_;
  const std::string path_ = folder_.file("head.isb");
  Query query_;
};

TEST_P(ReadAheadTest, EveryPartComesInOnceAndIsUsed) {
  const Pyramid pyramid(path_, kBudget, kReadAhead);
  SinkWithAStop sink([&] { waitForFetched(pyramid); });
  const ExtractionReport report = extractIsosurface(pyramid, query_, sink);
  const BrickPager::Counters counters = pyramid.parts().counters();
  EXPECT_GT(report.triangles, 0u);
  EXPECT_GT(counters.parts_fetched, 0u);
  EXPECT_EQ(counters.fetched_unused, 0u);
  EXPECT_EQ(counters.bytes_read, report.bytes_read);
  EXPECT_EQ(counters.parts_read, counters.misses + counters.parts_fetched);
}

TEST_P(ReadAheadTest, NothingIsFetchedWhereAllIsThere) {
  const Pyramid pyramid(path_);
  const std::uint64_t triangles = trianglesOf(pyramid);
  const BrickPager::Counters before = pyramid.parts().counters();
  EXPECT_EQ(trianglesOf(pyramid), triangles);
  EXPECT_EQ(pyramid.parts().counters().parts_fetched, before.parts_fetched);
  EXPECT_EQ(pyramid.parts().counters().misses, before.misses);
}

TEST_P(ReadAheadTest, WhatThePageCacheHasIsLeftToTheMeshers) {
  const DiskFolder disk;
  const std::string path = disk.file("head.isb");
  std::filesystem::copy_file(path_, path);
  const Pyramid pyramid(path);
  bool is_cached = true;
  forEachIndex({Index3(0), pyramid.layout().bricks(0)}, [&](const Index3& brick) {
    is_cached = is_cached && pyramid.parts().isCached(PartKind::kSamples, 0, brick);
  });
  if (!is_cached) GTEST_SKIP() << "this file system does not say what is cached";
  EXPECT_EQ(trianglesOf(pyramid), trianglesOf(Pyramid(path_, kBudget, kReadAhead)));
  EXPECT_GT(pyramid.parts().counters().misses, 0u);
  EXPECT_EQ(pyramid.parts().counters().parts_fetched, 0u);
}

TEST_P(ReadAheadTest, ACancelledQueryEndsItAndTheNextIsWhole) {
  const Pyramid whole(path_), pyramid(path_, kBudget, kReadAhead);
  const std::uint64_t triangles = trianglesOf(whole);
  CancelFlag cancel;
  Query query = query_;
  query.cancel = &cancel;
  SinkWithAStop sink([&] {
    waitForFetched(pyramid);
    cancel.request();
  });
  EXPECT_THROW(extractIsosurface(pyramid, query, sink), Cancelled);
  const std::uint64_t fetched = pyramid.parts().counters().parts_fetched;
  EXPECT_GT(fetched, 0u);
  EXPECT_EQ(trianglesOf(pyramid), triangles);
  // All that it fetched is there and is used: nothing is read twice, and nothing else.
  EXPECT_EQ(pyramid.parts().counters().bytes_read, whole.parts().counters().bytes_read);
  EXPECT_EQ(pyramid.parts().counters().parts_read, whole.parts().counters().parts_read);
  EXPECT_EQ(pyramid.parts().counters().fetched_unused, 0u);
}

// After the request each thread ends the part that it is at, however long the query takes to end.
TEST_P(ReadAheadTest, ACancelledQueryReadsNoFurther) {
  const std::string path = folder_.file("many.isb");
  BuildOptions options;
  options.brick_cells = 8;
  options.codec = GetParam();
  buildPyramid(*makePhantomSource(PhantomSpec{"head", 128, {}, 16}), path, options);
  const Pyramid whole(path);
  trianglesOf(whole);
  // The threads may have read all before the query is cancelled; in one of some runs they have not.
  for (int run = 0; run < 50; ++run) {
    const Pyramid pyramid(path, kBudget, kReadAhead);
    CancelFlag cancel;
    Query query = query_;
    query.cancel = &cancel;
    std::uint64_t read_before = 0;
    SinkWithAStop sink([&] {
      cancel.request();
      read_before = pyramid.parts().counters().parts_read;
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    });
    EXPECT_THROW(extractIsosurface(pyramid, query, sink), Cancelled);
    if (2 * read_before > whole.parts().counters().parts_read) continue;
    // Four threads read ahead, and a brick has ranges and samples.
    const auto threads = 4 + static_cast<unsigned>(tbb::this_task_arena::max_concurrency());
    EXPECT_LE(pyramid.parts().counters().parts_read - read_before, 2 * threads);
    return;
  }
  FAIL() << "all was read before any query could be cancelled";
}

// Fetched parts make room for each other, and those in use stay; what comes in ahead does not push
// out what came in before and was not used yet.
TEST_P(ReadAheadTest, KeepsASmallBudget) {
  const std::uint64_t triangles = trianglesOf(Pyramid(path_));
  constexpr std::uint64_t kMostSampleBytes = 20 * 20 * 20 * 2;
  const std::uint64_t budget = 32 * 3 * kMostSampleBytes;
  const Pyramid pyramid(path_, budget, kReadAhead);
  // Parts in use never go: a brick's samples and ranges for each mesher, and what four threads
  // bring in at the moment, with a packed copy beside it.
  const auto meshers = static_cast<std::uint64_t>(tbb::this_task_arena::max_concurrency());
  const std::uint64_t most_held = budget + 2 * (meshers + 4) * kMostSampleBytes;
  HeldSink sink(pyramid);
  for (int round = 0; round < 3; ++round) {
    EXPECT_EQ(extractIsosurface(pyramid, query_, sink).triangles, triangles);
    EXPECT_LE(pyramid.parts().heldBytes(), budget);
    SurfaceMesh mesh;
    EXPECT_EQ(extractIsosurface(pyramid, query_, mesh).triangles, triangles);
    EXPECT_LE(pyramid.parts().heldBytes(), budget);
  }
  EXPECT_GT(sink.mostHeld(), budget / 2);
  EXPECT_LE(sink.mostHeld(), most_held);
  const BrickPager::Counters counters = pyramid.parts().counters();
  EXPECT_GT(counters.parts_released, 0u);
  EXPECT_GT(counters.parts_fetched, 0u);
  // A thread that the system lets wait may bring in what the mesher has read, used and released.
  EXPECT_LE(counters.fetched_unused, counters.parts_fetched / 20);
}

// Its own promise, with nobody who reaches what it reads.
TEST_P(ReadAheadTest, ReadsNoFurtherAheadThanAThirtySecondOfTheBudget) {
  constexpr std::uint64_t kMostSampleBytes = 20 * 20 * 20 * 2;
  constexpr int kBricksAhead = 3;
  const Pyramid pyramid(path_, 32 * kBricksAhead * kMostSampleBytes, kReadAhead);
  query_.cull_by_ranges = false;  // all bricks, and of each its samples alone
  const std::vector<ChoiceOracles> oracles = oraclesOf(pyramid, query_);
  const WorldFrame frame(pyramid.spec().geometry, pyramid.valueRange());
  ReadLog log;
  const MeshContext context{pyramid, query_, oracles, frame, 500.0F, log, pyramid.parts().edition(),
                            nullptr};
  std::vector<BrickWork> work;
  forEachIndex({Index3(0), pyramid.layout().bricks(0)}, [&](const Index3& brick) {
    work.push_back({0, brick, false});
  });
  ReadAhead ahead(context, work);
  static_cast<void>(pyramid.samples(0, work[0].brick));  // a miss, which begins it
  ahead.reached(0);
  waitForFetched(pyramid);
  std::this_thread::sleep_for(std::chrono::milliseconds(100));  // it has not gone on
  EXPECT_GT(pyramid.parts().counters().parts_fetched, 0u);
  EXPECT_LE(pyramid.parts().counters().parts_fetched,
            2u * kBricksAhead);  // some bricks are smaller
  EXPECT_LE(pyramid.parts().heldBytes(), (1 + kBricksAhead) * kMostSampleBytes * 33 / 32);
}

INSTANTIATE_TEST_SUITE_P(All, ReadAheadTest, testing::Values(Codec::kStored, Codec::kZstd),
                         [](const auto& test) {
                           return std::string(test.param == Codec::kStored ? "Stored" : "Packed");
                         });

}  // namespace
}  // namespace isobrick::test
