// One Extractor and one mesh for many queries, also after some that failed; plans in ranges.
#include <gtest/gtest.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>
#include <tbb/task_group.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <stdexcept>
#include <thread>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/indexed_mesh.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "tests/support/array_source.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

constexpr double kIsovalue = 100.5;

// A volume of many bricks, most of them with a part of the surface.
class ExtractorSession : public testing::Test {
 protected:
  static constexpr std::int64_t kEdge = 48;

  ExtractorSession() : path_(folder_.file("waves.isb")) {
    const auto wave = [](std::int64_t i) { return std::sin(0.4 * static_cast<double>(i)); };
    ArraySource<std::uint8_t> source(
        Index3(kEdge), arrayOfField<std::uint8_t>(Index3(kEdge), [&](const Index3& i) {
          return 100 + 30 * (wave(i.x) + wave(i.y + 2) + wave(i.z));
        }));
    BuildOptions options;
    options.brick_cells = 8;
    buildPyramid(source, path_, options);
  }

  static Query uniformQuery() {
    Query query;
    query.isovalue = kIsovalue;
    return query;
  }
  // Bricks of several levels, plain and mixed.
  static Query focusQuery() {
    Query query = uniformQuery();
    query.focus = FocusSphere{glm::dvec3(9), 3};
    return query;
  }
  // Changes bytes of the samples of many bricks, so that their checksums are wrong.
  void damage() {
    const auto size = static_cast<std::streamoff>(std::filesystem::file_size(path_));
    std::fstream file(path_, std::ios::in | std::ios::out | std::ios::binary);
    for (std::streamoff at = size / 4; at < size / 2; at += 100) {
      file.seekg(at);
      const char old = static_cast<char>(file.peek());
      file.seekp(at);
      file.put(static_cast<char>(old ^ 1));
    }
  }

  TemporaryFolder folder_;
  std::string path_;
};

void expectEmpty(const SurfaceMesh& mesh) {
  EXPECT_TRUE(mesh.positions().empty());
  EXPECT_TRUE(mesh.normals().empty());
  EXPECT_TRUE(mesh.triangles().empty());
  EXPECT_TRUE(mesh.parts().empty());
}

void expectSame(const IndexedMesh& a, const IndexedMesh& b) {
  EXPECT_TRUE(a.positions == b.positions);
  EXPECT_TRUE(a.normals == b.normals);
  EXPECT_TRUE(a.triangles == b.triangles);
  EXPECT_FALSE(a.triangles.empty());
}

IndexedMesh meshOf(Extractor& extractor, const Query& query) {
  IndexedMeshSink sink;
  extractor.extract(query, sink);
  return sink.takeMesh();
}

// Collects like its base; at batch `at` it does something.
class ActingSink : public IndexedMeshSink {
 public:
  ActingSink(int at, std::function<void()> act) : at_(at), act_(std::move(act)) {}
  void place(PlacedBatch& placed) override {
    if (batches_++ == at_) act_();
    IndexedMeshSink::place(placed);
  }
  void finish() override { finished_ = true; }
  int batches() const { return batches_; }
  bool finished() const { return finished_; }

 private:
  int at_, batches_ = 0;
  std::function<void()> act_;
  bool finished_ = false;
};

// A plan's ranges into one sink.
class JoiningSink : public IndexedMeshSink {
 public:
  void finish() override { ++ranges_; }
  int ranges() const { return ranges_; }

 private:
  int ranges_ = 0;
};

TEST_F(ExtractorSession, RangesOfAPlanJoinedByTheirEdgesAreTheWhole) {
  const Pyramid pyramid(path_);
  Extractor extractor(pyramid);
  for (const Query& query : {uniformQuery(), focusQuery()}) {
    const IndexedMesh whole = meshOf(extractor, query);
    const ExtractionPlan plan = extractor.plan(query);
    JoiningSink sink;
    std::uint64_t triangles = 0;
    std::size_t count = 0;
    for (std::size_t first = 0; first < plan.bricks().size(); first += count) {
      count = count % 7 + 1;
      triangles += first % 2 == 0 ? extractor.execute(plan, first, count, sink).triangles
                                  : Extractor(pyramid).execute(plan, first, count, sink).triangles;
    }
    EXPECT_GT(sink.ranges(), 3);
    EXPECT_EQ(triangles, whole.triangles.size() / 3);
    expectSame(sink.mesh(), whole);
    EXPECT_EQ(extractor.execute(plan, plan.bricks().size() + 1, 9, sink).triangles, 0u);
  }
}

// A sink that waits for a loop of its own could begin one of the pipeline's loops meanwhile, which
// waits for the sink.
TEST_F(ExtractorSession, ASinkMayUseThreadsOfItsOwn) {
  class ParallelSink : public TriangleSink {
   public:
    void accept(const MeshBatch& batch) override {
      tbb::parallel_for(0, 200,
                        [](int) { std::this_thread::sleep_for(std::chrono::microseconds(20)); });
      triangles += batch.triangles.size() / 3;
    }
    std::uint64_t triangles = 0;
  };
  const Pyramid pyramid(path_);
  for (const Query& query : {uniformQuery(), focusQuery()}) {
    ParallelSink sink;
    ExtractionReport report;
    tbb::task_arena(8).execute([&] { report = extractIsosurface(pyramid, query, sink); });
    EXPECT_EQ(sink.triangles, report.triangles);
  }
}

TEST_F(ExtractorSession, IsDoneWhenTheLastBrickIsMeshed) {
  class Watcher : public TriangleSink {
   public:
    explicit Watcher(const std::atomic<float>& done) : done_(done) {}
    void prepare(PlacedBatch&) override { greatest = std::max(greatest, done_.load()); }
    float greatest = 0;

   private:
    const std::atomic<float>& done_;
  };
  const Pyramid pyramid(path_);
  Query query = uniformQuery();
  std::atomic<float> done{0};
  query.fraction_done = &done;
  Watcher watcher(done);
  tbb::task_arena(1).execute([&] { extractIsosurface(pyramid, query, watcher); });
  EXPECT_LT(watcher.greatest, 1.0F);
  EXPECT_EQ(done, 1.0F);
}

TEST_F(ExtractorSession, WorksOnAfterASinkThatFailed) {
  const Pyramid pyramid(path_);
  Extractor extractor(pyramid);
  const IndexedMesh uniform = meshOf(extractor, uniformQuery());
  const IndexedMesh mixed = meshOf(extractor, focusQuery());
  SurfaceMesh mesh;
  for (const int batch : {0, 1, 2, 3, 4, 5}) {
    ActingSink failing(batch, [] { throw std::runtime_error("full"); });
    EXPECT_THROW(extractor.extract(batch % 2 == 0 ? focusQuery() : uniformQuery(), failing),
                 std::runtime_error);
    EXPECT_FALSE(failing.finished());
    expectSame(meshOf(extractor, uniformQuery()), uniform);
    expectSame(meshOf(extractor, focusQuery()), mixed);
    extractor.extract(uniformQuery(), mesh);
    EXPECT_EQ(mesh.triangles().size(), uniform.triangles.size());
    extractor.extract(focusQuery(), mesh);
    EXPECT_EQ(mesh.triangles().size(), mixed.triangles.size());
  }
}

TEST_F(ExtractorSession, AMeshIsEmptyAfterAnException) {
  SurfaceMesh mesh;
  {
    const Pyramid pyramid(path_);
    Extractor extractor(pyramid);
    extractor.extract(focusQuery(), mesh);
    ASSERT_FALSE(mesh.parts().empty());
    Query senseless = uniformQuery();
    senseless.isovalue = std::numeric_limits<double>::infinity();
    EXPECT_THROW(extractor.extract(senseless, mesh), Error);
    expectEmpty(mesh);

    extractor.extract(focusQuery(), mesh);
    CancelFlag cancel;
    cancel.request();
    Query cancelled = focusQuery();
    cancelled.cancel = &cancel;
    EXPECT_THROW(extractor.extract(cancelled, mesh), Cancelled);
    expectEmpty(mesh);
  }
  damage();
  const Pyramid pyramid(path_);
  Extractor extractor(pyramid);
  Query everywhere = focusQuery();  // mixed bricks, and the damaged one with them
  everywhere.focus->radius = 18;
  for (const Query& query : {uniformQuery(), everywhere}) {
    EXPECT_THROW(extractor.extract(query, mesh), Error);
    expectEmpty(mesh);
  }
}

// A query inside a task whose group somebody cancels is not cut short, silently, in the middle.
TEST_F(ExtractorSession, IsNotCutShortByTheTaskThatItRunsIn) {
  const Pyramid pyramid(path_);
  Extractor extractor(pyramid);
  for (const Query& query : {uniformQuery(), focusQuery()}) {
    const IndexedMesh whole = meshOf(extractor, query);
    for (const int concurrency : {1, 4}) {
      tbb::task_arena arena(concurrency);
      arena.execute([&] {
        tbb::task_group group;
        ActingSink sink(3, [&] { group.cancel(); });
        group.run_and_wait([&] { extractor.extract(query, sink); });
        expectSame(sink.mesh(), whole);
      });
      arena.execute([&] { expectSame(meshOf(extractor, query), whole); });
      arena.execute([&] {
        tbb::task_group group;
        SurfaceMesh mesh;
        group.run_and_wait([&] {
          group.cancel();
          extractor.extract(query, mesh);
        });
        EXPECT_EQ(mesh.triangles().size(), whole.triangles.size());
      });
    }
  }
}

}  // namespace
}  // namespace isobrick::test
