// Requests in, whole surfaces out: in any order of requests, within the budget, errors included.
#include "isobrick/viewer/stream/surface_stream.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <deque>
#include <glm/geometric.hpp>
#include <set>
#include <thread>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/indexed_mesh.h"
#include "isobrick/extract/sinks/vertex_numbering.h"
#include "isobrick/viewer/session/drawn_scene.h"
#include "isobrick/viewer/stream/latest_worker.h"
#include "isobrick/viewer/stream/surface_set.h"
#include "tests/support/field_pyramid.h"
#include "tests/support/keeping_renderer.h"
#include "tests/support/mesh_checker.h"
#include "tests/support/null_renderer.h"

namespace isobrick {
namespace {

using MessageMessageKind = StreamMessage::Kind;

class SurfaceStreamTest : public ::testing::Test {
 protected:
  SurfaceStreamTest() {
    BuildOptions options;
    options.brick_cells = 16;
    path_ = test::buildField(
        folder_, Index3(60),
        [](const glm::dvec3& p) { return 25.0 - glm::distance(p, glm::dvec3(30.0)); }, options);
    pyramid_ = std::make_shared<const Pyramid>(path_);
  }

  static StreamPass pass(double radius, double isovalue = 5.5) {
    StreamPass result;
    result.radius = radius;
    Query query;
    query.isovalue = isovalue;
    query.focus = FocusSphere{{10.0, 20.0, 30.0}, radius};
    result.queries.push_back({0, query});
    return result;
  }
  std::uint64_t trianglesOf(const StreamPass& pass) const {
    CountingSink sink;
    return extractIsosurface(*pyramid_, pass.queries[0].query, sink).triangles;
  }
  static std::uint64_t kept(const NullRenderer& renderer, const std::vector<ChunkId>& chunks) {
    std::uint64_t triangles = 0;
    for (const ChunkId chunk : chunks) triangles += renderer.kept().at(chunk).triangles;
    return triangles;
  }
  // Frames until nothing is under way; `look` sees the set after each.
  template <typename Look>
  static void pumpAll(SurfaceStream& stream, SurfaceSet& set, Look&& look) {
    double clock = 0.0;
    while (stream.busy() || set.isReleasing()) {
      UploadAllowance allowance;
      look(set.pump([&] { return stream.poll(); }, [&] { return clock += 1e-4; }, allowance));
      std::this_thread::yield();
    }
  }

  test::TemporaryFolder folder_;
  std::string path_;
  std::shared_ptr<const Pyramid> pyramid_;
};

// However little patience there is against what a pass takes: without its growing, none would end.
TEST_F(SurfaceStreamTest, AHandThatNeverRestsSeesSurfacesOnASlowMachineToo) {
  SurfaceStream stream(pyramid_, 1, {}, 1e-9);
  int done = 0;
  for (int dropped = 0; done < 3 && dropped < 1000;) {
    stream.request({{pass(40.0)}});
    while (const auto message = stream.poll()) {
      dropped += message->kind == StreamMessage::Kind::kDropped;
      done += message->kind == StreamMessage::Kind::kPassDone;
    }
  }
  EXPECT_GE(done, 3);
}

// Chunks are packed on their way, and a taker that takes none keeps no thread waiting.
TEST_F(SurfaceStreamTest, APassThatHasNoRoomIsGivenUpIfNothingMayWait) {
  ChunkDelivery delivery;
  delivery.may_wait = false;
  delivery.pack = [](SurfaceChunk& chunk) {
    chunk.packed.resize(10'000);
    chunk.vertices.clear();
    chunk.triangles.clear();
  };
  SurfaceStream stream(pyramid_, 2, {}, SurfaceStream::kPatienceSeconds, nullptr, 30'000, delivery);
  stream.request({{pass(40.0)}, false});
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  bool has_end = false;
  while (!has_end)
    if (const auto message = stream.poll()) {
      has_end = true;  // its chunks went with it
      EXPECT_EQ(message->kind, MessageMessageKind::kDropped);
      EXPECT_TRUE(message->no_room);
    }
  EXPECT_FALSE(stream.busy());
  // What is taken in time is whole.
  stream.request({{pass(1.0)}, false});
  bool is_done = false;
  while (!is_done)
    if (const auto message = stream.poll()) {
      EXPECT_EQ(message->chunk.bytes(), message->kind == MessageMessageKind::kChunk ? 10'000u : 0u);
      if (message->kind == MessageMessageKind::kDropped) stream.request({{pass(1.0)}, false});
      is_done = message->kind == MessageMessageKind::kPassDone;
    }
}

// So a slow taker is never more than one pass behind.
TEST_F(SurfaceStreamTest, ATakerThatIsSlowGetsTheLatestRequestNext) {
  trianglesOf(pass(12.0));  // all bricks are in memory now
  ChunkDelivery delivery;
  delivery.may_wait = false;
  SurfaceStream stream(pyramid_, 2, {}, 60.0, nullptr, SurfaceStream::kQueueBytes, delivery);
  const std::uint64_t first = stream.request({{pass(12.0)}});
  auto message = stream.poll();
  while (!message) message = stream.poll();
  std::uint64_t last = 0;
  for (int i = 0; i < 20; ++i) {
    last = stream.request({{pass(12.0)}});
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  std::vector<std::uint64_t> done;
  while (stream.busy()) {
    if (message && message->kind == MessageMessageKind::kPassDone) done.push_back(message->request);
    message = stream.poll();
  }
  if (message && message->kind == MessageMessageKind::kPassDone) done.push_back(message->request);
  done.erase(std::unique(done.begin(), done.end()), done.end());  // coarser first, perhaps
  EXPECT_EQ(done, (std::vector<std::uint64_t>{first, last}));
}

TEST_F(SurfaceStreamTest, PassesAreShownWholeAndReplaceEachOther) {
  SurfaceStream stream(pyramid_, 2);
  NullRenderer renderer;
  SurfaceSet set(renderer, 1 << 30);
  const StreamRequest request{{pass(4.0), pass(12.0), pass(40.0)}, false};
  const std::uint64_t number = stream.request(request);
  std::vector<double> radii;
  pumpAll(stream, set, [&](const SurfaceSet::News& news) {
    for (const StreamMessage& done : news.passes) {
      EXPECT_EQ(done.request, number);
      EXPECT_EQ(done.pass, radii.size());
      EXPECT_EQ(done.last_pass, done.pass == 2);
      EXPECT_EQ(done.triangles, trianglesOf(request.passes[done.pass]));
      EXPECT_GT(done.bricks_read, 0u);
      radii.push_back(done.radius);
    }
    // Between them nothing half-made is shown.
    if (!radii.empty())
      EXPECT_EQ(kept(renderer, set.shown()), trianglesOf(request.passes[radii.size() - 1]));
    else
      EXPECT_TRUE(set.shown().empty());
  });
  EXPECT_EQ(radii, (std::vector<double>{4.0, 12.0, 40.0}));
  EXPECT_EQ(renderer.kept().size(), set.shown().size());
  EXPECT_EQ(set.incomingBytes(), 0u);
  EXPECT_EQ(set.shownBytes(), renderer.bytesKept());
}

TEST_F(SurfaceStreamTest, BricksThatStayTheSameAreNotMadeAgain) {
  SurfaceStream stream(pyramid_, 2);
  test::KeepingRenderer renderer;
  auto set = std::make_unique<SurfaceSet>(renderer, 1 << 30);
  const auto triangleOf = [&](double radius) { return trianglesOf(pass(radius)); };
  std::vector<StreamMessage> passes;
  bool stale = false;
  const auto show = [&](StreamRequest request) {
    passes.clear();
    stale = false;
    stream.request(std::move(request));
    pumpAll(stream, *set, [&](const SurfaceSet::News& news) {
      passes.insert(passes.end(), news.passes.begin(), news.passes.end());
      stale = stale || news.stale;
    });
    IndexedMeshSink sink;
    takeShownMesh(renderer, set->shown(), {}, sink);
    const IndexedMesh& mesh = sink.mesh();
    const test::MeshReport report =
        test::checkMesh(mesh.positions, mesh.triangles, test::indexOptions(Index3(60)));
    EXPECT_TRUE(report.ok()) << report.summary();
    return mesh.triangles.size() / 3;
  };
  // From pass to pass of a request, and from request to request.
  EXPECT_EQ(show({{pass(30.0), pass(45.0)}, false}), triangleOf(45.0));
  ASSERT_EQ(passes.size(), 2u);
  EXPECT_EQ(passes[0].triangles_made, passes[0].triangles);
  EXPECT_GT(passes[1].reused.size(), 0u);
  EXPECT_LT(passes[1].triangles_made, passes[1].triangles);
  EXPECT_EQ(passes[1].triangles, triangleOf(45.0));
  EXPECT_EQ(show({{pass(30.0)}, false}), triangleOf(30.0));
  EXPECT_GT(passes.at(0).reused.size(), 0u);
  std::uint64_t of_levels = 0;
  for (const LevelCounts& counts : passes[0].surfaces.at(0).levels) of_levels += counts.triangles;
  EXPECT_EQ(of_levels, triangleOf(30.0));
  EXPECT_EQ(renderer.kept().size(), set->shown().size());
  EXPECT_EQ(set->shownBytes(), renderer.bytesKept());
  // Not for another isovalue or other values.
  EXPECT_EQ(show({{pass(30.0, 4.25)}, false}), trianglesOf(pass(30.0, 4.25)));
  EXPECT_EQ(passes.at(0).reused.size(), 0u);
  StreamRequest colored{{pass(30.0, 4.25)}, false};
  colored.values.what = StreamValues::What::kGradient;
  show(colored);
  EXPECT_EQ(passes.at(0).reused.size(), 0u);
  show(colored);
  EXPECT_GT(passes.at(0).reused.size(), 0u);
  // What is not there any longer is no part of a surface.
  set = std::make_unique<SurfaceSet>(renderer, 1 << 30);
  EXPECT_EQ(show(colored), 0u);
  EXPECT_TRUE(stale);
  EXPECT_EQ(set->incomingBytes(), 0u);
  colored.may_reuse = false;
  EXPECT_EQ(show(colored), trianglesOf(pass(30.0, 4.25)));
  EXPECT_FALSE(stale);
}

TEST_F(SurfaceStreamTest, TheLastOfManyRequestsIsWhatStays) {
  SurfaceStream stream(pyramid_, 2);
  NullRenderer renderer;
  SurfaceSet set(renderer, 1 << 30);
  double clock = 0.0;
  std::uint64_t last = 0;
  for (int i = 0; i < 200; ++i) {
    last = stream.request({{pass(4.0, 1.0 + 0.1 * i), pass(50.0, 1.0 + 0.1 * i)}});
    UploadAllowance allowance;
    if (i % 3 == 0)
      set.pump([&] { return stream.poll(); }, [&] { return clock += 1e-4; }, allowance);
  }
  std::uint64_t shown_request = 0;
  double shown_radius = 0.0;
  pumpAll(stream, set, [&](const SurfaceSet::News& news) {
    for (const StreamMessage& done : news.passes) {
      EXPECT_GE(done.request, shown_request);
      shown_request = done.request;
      shown_radius = done.radius;
    }
  });
  EXPECT_EQ(shown_request, last);
  EXPECT_EQ(shown_radius, 50.0);
  EXPECT_EQ(kept(renderer, set.shown()), trianglesOf(pass(50.0, 1.0 + 0.1 * 199)));
  EXPECT_EQ(renderer.kept().size(), set.shown().size());
}

// Its uploads would come before what the user waits for.
TEST_F(SurfaceStreamTest, OfWhatNoHandWaitsForNothingComesAfterTheNextRequest) {
  SurfaceStream stream(pyramid_, 2);
  NullRenderer renderer;
  SurfaceSet set(renderer, 1 << 30);
  for (int i = 0; i < 10; ++i) {
    const std::uint64_t at_rest = stream.request({{pass(4.0), pass(50.0)}});
    const auto isAtRest = [&](const StreamMessage& message) {
      return message.request == at_rest && message.pass == 1;
    };
    std::deque<StreamMessage> messages;
    do {
      if (auto message = stream.poll()) messages.push_back(std::move(*message));
    } while (messages.empty() || !isAtRest(messages.back()));
    if (i % 2 == 1) std::this_thread::sleep_for(std::chrono::milliseconds(5));  // it is done
    stream.request({{pass(6.0)}});
    while (stream.busy()) {
      auto message = stream.poll();
      if (!message) continue;
      EXPECT_TRUE(!isAtRest(*message) || message->kind == StreamMessage::Kind::kDropped);
      messages.push_back(std::move(*message));
    }
    UploadAllowance allowance;
    const auto next = [&]() -> std::optional<StreamMessage> {
      if (messages.empty()) return std::nullopt;
      StreamMessage message = std::move(messages.front());
      messages.pop_front();
      return message;
    };
    const SurfaceSet::News news = set.pump(
        next, [] { return 0.0; }, allowance);
    ASSERT_FALSE(news.passes.empty());
    EXPECT_EQ(news.passes.back().radius, 6.0);
    EXPECT_FALSE(news.stale);
    EXPECT_EQ(kept(renderer, set.shown()), trianglesOf(pass(6.0)));
    EXPECT_EQ(renderer.kept().size(), set.shown().size());
  }
}

// A request that comes between the last chunk of a pass and its end takes the chunks that wait out
// of the queue: so the pass must not end as one that is done.
TEST_F(SurfaceStreamTest, APassThatIsDoneAsTheNextRequestComesIsDropped) {
  SurfaceStream stream(pyramid_, 2);
  std::size_t all_chunks = 0;
  int dropped = 0;
  for (int round = 0; round < 60; ++round) {
    const std::uint64_t at_rest = stream.request({{pass(4.0), pass(50.0)}});
    const auto isAtRest = [&](const StreamMessage& message) {
      return message.request == at_rest && message.pass == 1;
    };
    // The first two tell how many chunks there are.
    std::size_t chunks = 0;
    bool is_done = false;
    while (!is_done && (round < 2 || chunks < all_chunks)) {
      const auto message = stream.poll();
      if (!message || !isAtRest(*message)) continue;
      is_done = message->kind != StreamMessage::Kind::kChunk;
      if (!is_done) ++chunks;
    }
    if (round < 2) all_chunks = chunks;
    stream.request({{pass(6.0)}});
    while (stream.busy()) {
      const auto message = stream.poll();
      if (!message || !isAtRest(*message)) continue;
      EXPECT_EQ(message->kind, StreamMessage::Kind::kDropped) << round;
      ++dropped;
    }
  }
  EXPECT_GT(all_chunks, 0u);
  EXPECT_GT(dropped, 0);
}

TEST_F(SurfaceStreamTest, OnAColdFileASurfaceIsThereBeforeItsBricksAre) {
  SurfaceStream stream(pyramid_, 2);
  NullRenderer renderer;
  SurfaceSet set(renderer, 1 << 30);
  stream.request({{pass(12.0), pass(40.0)}});
  std::vector<StreamMessage> shown;
  pumpAll(stream, set, [&](const SurfaceSet::News& news) {
    for (const StreamMessage& done : news.passes) {
      EXPECT_GT(done.triangles, 0u);
      shown.push_back(done);
    }
  });
  ASSERT_EQ(shown.size(), 3u);
  EXPECT_FALSE(shown[0].is_complete);
  EXPECT_LT(shown[0].triangles, trianglesOf(pass(12.0)));
  EXPECT_TRUE(shown[1].is_complete);
  EXPECT_EQ(shown[1].triangles, trianglesOf(pass(12.0)));
  EXPECT_FALSE(shown[1].last_pass);
  EXPECT_EQ(kept(renderer, set.shown()), trianglesOf(pass(40.0)));
  // Now all is there.
  stream.request({{pass(12.0)}});
  pumpAll(stream, set, [&](const SurfaceSet::News& news) {
    for (const StreamMessage& done : news.passes) shown.push_back(done);
  });
  ASSERT_EQ(shown.size(), 4u);
  EXPECT_TRUE(shown[3].is_complete && shown[3].last_pass);
}

TEST_F(SurfaceStreamTest, WhatHasTooManyTrianglesGivesWayToTheFirstThatFits) {
  SurfaceStream stream(pyramid_, 2);
  NullRenderer renderer;
  SurfaceSet set(renderer, 1 << 30);
  const auto shownRadius = [&](std::uint64_t most) {
    stream.request({{pass(40.0)}, false, {pass(20.0), pass(10.0)}, most});
    double radius = 0.0, expected = 40.0;
    bool is_done = false;
    pumpAll(stream, set, [&](const SurfaceSet::News& news) {
      for (const StreamMessage& pass : news.passes) {
        EXPECT_FALSE(is_done);
        EXPECT_EQ(pass.radius, expected);
        expected *= 0.5;
        if (pass.too_many) {
          EXPECT_GT(pass.triangles_made, most);
        }
        is_done = !pass.too_many;
        radius = pass.radius;
      }
    });
    EXPECT_TRUE(is_done);
    EXPECT_EQ(kept(renderer, set.shown()), trianglesOf(pass(radius)));
    EXPECT_EQ(renderer.kept().size(), set.shown().size());
    return radius;
  };
  ASSERT_LT(trianglesOf(pass(20.0)), trianglesOf(pass(40.0)));
  EXPECT_EQ(shownRadius(trianglesOf(pass(40.0))), 40.0);
  EXPECT_EQ(shownRadius(trianglesOf(pass(20.0))), 20.0);
  EXPECT_EQ(shownRadius(1), 10.0);
  EXPECT_EQ(shownRadius(0), 40.0);
}

TEST_F(SurfaceStreamTest, TwoSurfacesComeTogether) {
  SurfaceStream stream(pyramid_, 1);
  NullRenderer renderer;
  SurfaceSet set(renderer, 1 << 30);
  StreamPass both = pass(20.0, 2.0);
  both.queries.push_back({1, pass(20.0, 15.0).queries[0].query});
  stream.request({{both}});
  pumpAll(stream, set, [](const SurfaceSet::News&) {});
  std::set<int> surfaces;
  for (const auto& [id, chunk] : renderer.kept()) surfaces.insert(chunk.surface);
  EXPECT_EQ(surfaces, (std::set<int>{0, 1}));
}

TEST_F(SurfaceStreamTest, WhatDoesNotFitTheBudgetLeavesWhatIsShown) {
  SurfaceStream stream(pyramid_, 2);
  NullRenderer renderer;
  SurfaceSet set(renderer, 100'000);
  stream.request({{pass(2.0)}});
  pumpAll(stream, set, [](const SurfaceSet::News&) {});
  const std::vector<ChunkId> before = set.shown();
  ASSERT_FALSE(before.empty());
  stream.request({{pass(60.0)}, false});
  bool over = false;
  pumpAll(stream, set, [&](const SurfaceSet::News& news) {
    over = over || news.over_budget;
    EXPECT_LE(renderer.bytesKept(), 100'000u);
  });
  EXPECT_TRUE(over);
  EXPECT_EQ(set.shown(), before);
  EXPECT_EQ(renderer.kept().size(), before.size());
}

TEST_F(SurfaceStreamTest, AnErrorIsToldAndTheRestGoesOn) {
  SurfaceStream stream(pyramid_, 2);
  NullRenderer renderer;
  SurfaceSet set(renderer, 1 << 30);
  stream.request({{pass(4.0)}});
  pumpAll(stream, set, [](const SurfaceSet::News&) {});
  const std::vector<ChunkId> before = set.shown();
  StreamPass wrong = pass(4.0);
  wrong.queries[0].query.uniform_level = 99;
  wrong.queries[0].query.focus.reset();
  stream.request({{wrong}});
  bool failed = false;
  pumpAll(stream, set, [&](const SurfaceSet::News& news) { failed = failed || news.failed; });
  EXPECT_TRUE(failed);
  EXPECT_NE(set.error().find("level 99"), std::string::npos) << set.error();
  EXPECT_EQ(set.shown(), before);
  stream.request({{pass(8.0)}});
  pumpAll(stream, set, [](const SurfaceSet::News&) {});
  EXPECT_EQ(kept(renderer, set.shown()), trianglesOf(pass(8.0)));
  EXPECT_TRUE(set.error().empty());
}

TEST_F(SurfaceStreamTest, EndsInTheMiddleOfWork) {
  for (int i = 0; i < 20; ++i) {
    SurfaceStream stream(pyramid_, 2);
    stream.request({{pass(60.0), pass(50.0)}});
    if (i % 2 == 0) stream.cancel();
    if (i % 3 == 0) stream.poll();
  }
}

TEST(LatestWorkerTest, AnOutcomeIsNotGivenAfterANewerRequest) {
  std::atomic<bool> is_done{false};
  LatestWorker<int, int> worker([&](const int& request, const CancelFlag&) {
    is_done = true;
    return request;
  });
  worker.request(1);
  while (!is_done) std::this_thread::yield();
  std::this_thread::sleep_for(std::chrono::milliseconds(20));  // the outcome is there
  worker.request(2);
  auto outcome = worker.poll();
  for (; !outcome; outcome = worker.poll()) std::this_thread::yield();
  EXPECT_EQ(outcome->request, 2);
}

TEST(LatestWorkerTest, OnlyTheLastRequestHasAnOutcome) {
  LatestWorker<int, int> worker([](const int& request, const CancelFlag& cancel) {
    cancel.check();
    if (request < 0) throw Error("below 0");
    return 2 * request;
  });
  const auto outcome = [&] {
    while (true) {
      if (auto result = worker.poll()) return *result;
      std::this_thread::yield();
    }
  };
  for (int i = 0; i <= 50; ++i) worker.request(i);
  auto last = outcome();
  while (last.request != 50) last = outcome();
  EXPECT_EQ(last.result, 100);
  worker.request(-1);
  const auto failure = outcome();
  EXPECT_FALSE(failure.result);
  EXPECT_EQ(failure.error, "below 0");
  EXPECT_FALSE(worker.busy());
}

}  // namespace
}  // namespace isobrick
