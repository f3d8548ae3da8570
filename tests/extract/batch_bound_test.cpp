// If batches are large and the sink is slow, the meshers wait rather than fill the memory.
#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <chrono>
#include <set>
#include <stdexcept>
#include <thread>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/session/mesh_pipeline.h"
#include "isobrick/extract/sinks/vertex_numbering.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/storage/index_loop.h"
#include "tests/support/array_source.h"
#include "tests/support/random_numbers.h"
#include "tests/support/repetitions.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

// Slow; knows which batches come round, and the largest.
class SlowSink : public TriangleSink {
 public:
  void accept(const MeshBatch& batch) override {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    largest = std::max(largest, batch.bytes());
    triangles += batch.triangles.size() / 3;
    batches.insert(&batch);
    if (triangles > fails_at) throw std::runtime_error("no more");
  }

  std::set<const MeshBatch*> batches;
  std::uint64_t largest = 0, triangles = 0, fails_at = ~std::uint64_t{0};
};

class BatchBound : public testing::Test {
 protected:
  static constexpr int kThreads = 4;

  // Noise: as many triangles as there can be, in 27 bricks.
  void SetUp() override {
    Random random(1);
    const Index3 dims(193);
    std::vector<std::uint8_t> values(static_cast<std::size_t>(elementCount(dims)));
    for (std::uint8_t& value : values) value = static_cast<std::uint8_t>(random());
    ArraySource<std::uint8_t> source(dims, std::move(values));
    BuildOptions options;
    options.with_curvature = false;
    buildPyramid(source, path_, options);
    query_.isovalue = 127.5;
  }
  // With meshers enough, whatever the machine has.
  template <typename F>
  static void run(F&& f) {
    const tbb::global_control threads(tbb::global_control::max_allowed_parallelism, kThreads);
    tbb::task_arena arena(kThreads);
    arena.execute(f);
  }

  const TemporaryFolder folder_;
  const std::string path_ = folder_.file("noise.isb");
  Query query_;
};

TEST_F(BatchBound, WhatIsUnderWayIsBounded) {
  const Pyramid pyramid(path_);
  SlowSink sink;
  run([&] { extractIsosurface(pyramid, query_, sink); });
  ASSERT_GT(sink.triangles, 1000000u);
  ASSERT_GT(sink.largest, JobBoard::kMostBytes / 2) << "small batches";
  // Batches that are meshed and not written, one for each thread, and the next in order.
  // Without the bound it would be four for each thread.
  EXPECT_LE(sink.batches.size(), JobBoard::kMostBytes / sink.largest + 1 + kThreads + 1);
}

// Meshers that wait for room hear of a failure, of a request to cancel, and of the next query.
TEST_F(BatchBound, NobodyWaitsForever) {
  const Pyramid pyramid(path_);
  Extractor extractor(pyramid);
  run([&] {
    SlowSink failing;
    failing.fails_at = 0;
    EXPECT_THROW(extractor.extract(query_, failing), std::runtime_error);

    CancelFlag cancel;
    Query cancelled = query_;
    cancelled.cancel = &cancel;
    std::thread canceller([&] {
      std::this_thread::sleep_for(std::chrono::milliseconds(30));
      cancel.request();
    });
    SlowSink slow;
    EXPECT_THROW(extractor.extract(cancelled, slow), Cancelled);
    canceller.join();

    SlowSink whole;
    extractor.extract(query_, whole);
    EXPECT_GT(whole.triangles, slow.triangles);
  });
}

TEST(BatchRing, LargeIdleBatchesGiveTheirMemoryBack) {
  BatchRing ring(1);
  ring.begin();
  PlacedBatch* const batch = ring.take();
  batch->components.resize(BatchRing::kMostIdleBytes / sizeof(std::uint32_t) + 1);
  ring.giveBack(batch);
  EXPECT_EQ(ring.take()->components.capacity(), 0u);
}

// A batch that is ready waits as a task of the thread that placed the one before. If that thread
// takes another job and waits for room, and so do all others, nobody is left to place it.
TEST(BatchBoundOfUnequalBatches, SomebodyAlwaysGoesOn) {
  const TemporaryFolder folder;
  Random random(2);
  const Index3 dims(321, 321, 65);  // 25 bricks: some of noise, the others with one voxel
  std::vector<std::uint8_t> values(static_cast<std::size_t>(elementCount(dims)));
  for (std::int64_t i = 0; i < elementCount(dims); ++i) {
    const Index3 at = indexAt(i, dims);
    const Index3 brick = at / std::int64_t{64}, inside = at - brick * std::int64_t{64};
    const bool is_noisy = (7 * brick.x + 3 * brick.y) % 5 == 0;
    values[static_cast<std::size_t>(i)] = is_noisy ? static_cast<std::uint8_t>(random())
                                          : inside == Index3(30) ? 255
                                                                 : 0;
  }
  ArraySource<std::uint8_t> source(dims, std::move(values));
  BuildOptions options;
  options.with_curvature = false;
  buildPyramid(source, folder.file("unequal.isb"), options);
  const Pyramid pyramid(folder.file("unequal.isb"));
  Extractor extractor(pyramid);
  Query query;
  query.isovalue = 127.5;
  for (const int threads : {2, 3, 4}) {
    const tbb::global_control control(tbb::global_control::max_allowed_parallelism,
                                      static_cast<std::size_t>(threads));
    tbb::task_arena arena(threads);
    for (int round = 0; round < repetitions(10); ++round)
      arena.execute([&] {
        CountingSink sink;
        EXPECT_GT(extractor.extract(query, sink).triangles, 1000000u);
      });
  }
}

}  // namespace
}  // namespace isobrick::test
