// Queries on pyramids behind HTTP: the same bytes, few round trips, and clear ends.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <functional>
#include <thread>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/vertex_numbering.h"
#include "isobrick/extract/surface_mesh.h"
#include "isobrick/preprocess/phantoms/phantom.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/storage/pyramid_parts.h"
#include "isobrick/storage/pyramid_verify.h"
#include "tests/support/file_bytes.h"
#include "tests/support/hashing_sink.h"
#include "tests/support/range_server.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

using format::Codec;
using Milliseconds = std::chrono::milliseconds;

constexpr std::uint64_t kBudget = Pyramid::kDefaultBudgetBytes;

class RemoteQueryTest : public testing::Test {
 protected:
  // "head.isb", the phantom.
  void build(int size = 96, std::int64_t brick_cells = 16, Codec codec = Codec::kLz4) {
    BuildOptions options;
    options.brick_cells = brick_cells;
    options.codec = codec;
    buildPyramid(*makePhantomSource(PhantomSpec{"head", size, {}, 16}), path_, options);
  }
  Pyramid open(const RangeServer& server, const std::string& behaviour = "good",
               std::uint64_t budget = kBudget) const {
    return Pyramid(server.url(behaviour + "/head.isb"), budget, FileAccess::kMap, remote_);
  }
  static Query focusQuery(double at, double radius, double isovalue = 500) {
    Query query;
    query.isovalue = isovalue;
    query.focus = FocusSphere{glm::dvec3(at), radius};
    return query;
  }
  static std::uint64_t meshOf(const Pyramid& pyramid, const Query& query) {
    HashingSink sink;
    extractIsosurface(pyramid, query, sink);
    return sink.value();
  }
  // The Error that a call ends with.
  static std::string failureOf(const std::function<void()>& call) {
    try {
      call();
    } catch (const Error& error) {
      return error.what();
    }
    return "no failure";
  }

  const TemporaryFolder folder_;
  const std::string path_ = folder_.file("head.isb");
  RemoteOptions remote_{.cache_folder = {}, .stall_seconds = 1, .tries = 3};
};

TEST_F(RemoteQueryTest, MeshesAreThoseOfTheLocalFile) {
  for (const Codec codec : {Codec::kStored, Codec::kZstd}) {
    build(96, 16, codec);
    const RangeServer server(folder_.path());
    const Pyramid local(path_);
    for (const std::uint64_t budget : {kBudget, std::uint64_t{1} << 20, std::uint64_t{0}}) {
      const Pyramid remote = open(server, "good", budget);
      Query uniform, curved = focusQuery(60, 12), boxed = focusQuery(40, 5, 1200);
      uniform.isovalue = 500;
      uniform.uniform_level = 1;
      curved.curvature_tolerance = 0.01;
      boxed.box = QueryBox{glm::dvec3(10), glm::dvec3(70)};
      for (const Query& query : {uniform, focusQuery(48, 10), curved, boxed})
        EXPECT_EQ(meshOf(remote, query), meshOf(local, query)) << budget;
      SurfaceMesh far, near;
      Extractor(remote).extract(focusQuery(30, 8), far);
      Extractor(local).extract(focusQuery(30, 8), near);
      EXPECT_TRUE(std::equal(far.positions().begin(), far.positions().end(),
                             near.positions().begin(), near.positions().end()));
    }
  }
}

TEST_F(RemoteQueryTest, AFocusQueryOnAFileJustOpenedTakesFourRoundTrips) {
  build(192, 32);
  const Pyramid local(path_);
  for (const double at : {50.0, 96.0, 140.0}) {
    const Query query = focusQuery(at, 20);
    const RangeServer server(folder_.path(), {"--waves", "150"});
    const Pyramid remote = open(server);
    EXPECT_EQ(server.waves(), 2u) << "the header, then the tables";
    const std::uint64_t open_bytes = remote.remoteCounters().bytes;
    HashingSink sink;
    const ExtractionReport report = extractIsosurface(remote, query, sink);
    EXPECT_LE(server.waves(), 4u) << at;
    EXPECT_LE(static_cast<double>(remote.remoteCounters().bytes - open_bytes),
              1.2 * static_cast<double>(report.bytes_active))
        << at;
    EXPECT_EQ(sink.value(), meshOf(local, query));
  }
}

// 37,449 bricks, whose rows have 3.6 MB.
TEST_F(RemoteQueryTest, RowsOfALongBrickTableComeTogether) {
  build(128, 4);
  const RangeServer server(folder_.path(), {"--waves", "150"});
  const Pyramid remote = open(server);
  const std::uint64_t open_bytes = remote.remoteCounters().bytes;
  EXPECT_LE(open_bytes, std::uint64_t{64} << 10) << "opening reads no long table";
  const Query query = focusQuery(64, 3);
  EXPECT_EQ(meshOf(remote, query), meshOf(Pyramid(path_), query));
  // Rows, ranges and samples, at most 32 requests at once.
  EXPECT_LE(server.waves(), 2 + 3 + server.requests() / 32);
}

TEST_F(RemoteQueryTest, ProgressiveQueriesEndWithTheSameMesh) {
  build();
  const RangeServer server(folder_.path());
  const Pyramid remote = open(server), local(path_);
  Query query = focusQuery(48, 10);
  const std::uint64_t whole = meshOf(local, query);
  query.is_progressive = true;
  Extractor extractor(remote);
  for (int pass = 0; pass < 1000; ++pass) {
    HashingSink sink;
    const ExtractionReport report = extractor.extract(query, sink);
    if (report.is_complete) {
      EXPECT_EQ(sink.value(), whole);
      return;
    }
    extractor.waitForBricks(Milliseconds(50));
  }
  FAIL() << "never complete";
}

// The parts of many bricks are on their way at once.
TEST_F(RemoteQueryTest, ProgressiveQueriesDoNotWaitForOneBrickAfterTheOther) {
  build();
  const RangeServer server(folder_.path(), {"--waves", "100"});
  const Pyramid remote = open(server);
  Query query = focusQuery(48, 10);
  query.is_progressive = true;
  Extractor extractor(remote);
  bool is_complete = false;
  for (int pass = 0; pass < 1000 && !is_complete; ++pass) {
    CountingSink sink;
    is_complete = extractor.extract(query, sink).is_complete;
    if (!is_complete) extractor.waitForBricks(Milliseconds(300));
  }
  EXPECT_TRUE(is_complete);
  EXPECT_LE(server.waves() * 4, server.requests());
}

TEST_F(RemoteQueryTest, VerificationPassesOverAllOfIt) {
  build();
  const RangeServer server(folder_.path());
  const Pyramid remote = open(server);
  EXPECT_TRUE(verifyPyramid(remote).empty());
  EXPECT_EQ(remote.sums().bytes.total, Pyramid(path_).sums().bytes.total);
  EXPECT_EQ(remote.histogram().counts().size(), Pyramid(path_).histogram().counts().size());
}

// ---- failures

TEST_F(RemoteQueryTest, GarbageIsNamedByItsBrick) {
  build();
  const RangeServer server(folder_.path());
  const std::string at_opening = failureOf([&] { open(server, "garbage"); });
  EXPECT_NE(at_opening.find("damaged"), std::string::npos) << at_opening;
  EXPECT_NE(failureOf([&] { open(server, "garbage/first"); }).find("not an isobrick pyramid"),
            std::string::npos);
  // The disk of the server changes a byte of a brick, and nothing else.
  const std::string whole = readBytes(path_);
  std::string damaged = whole;
  const Pyramid remote = open(server);
  const auto entry = remote.parts().brickRowOf(0, Index3(2)).part(PartKind::kSamples);
  damaged[entry.offset + 7] = static_cast<char>(damaged[entry.offset + 7] ^ 1);
  writeBytes(path_, damaged);
  const std::string what = failureOf([&] { remote.samples(0, Index3(2)); });
  EXPECT_NE(what.find("brick (2,2,2) of level 0, samples"), std::string::npos) << what;
  EXPECT_NE(what.find("is damaged (checksum mismatch); build it again"), std::string::npos) << what;
  writeBytes(path_, whole);
  EXPECT_NE(remote.samples(0, Index3(2)).part.data(), nullptr) << "it is asked for again";
}

TEST_F(RemoteQueryTest, AFileThatChangedEndsTheQuery) {
  build();
  const RangeServer server(folder_.path());
  for (const char* const how : {"etag", "silent-etag", "time", "size"}) {
    const std::string what = failureOf([&] {
      const Pyramid remote = open(server, std::string("changes/") + how);
      meshOf(remote, focusQuery(48, 10));
    });
    EXPECT_NE(what.find("the file was changed while it was open; open it again"), std::string::npos)
        << what;
    EXPECT_EQ(what.find("build it again"), std::string::npos) << what;
  }
}

TEST_F(RemoteQueryTest, AHangingServerEndsTheQueryWithTheBrick) {
  build();
  const RangeServer server(folder_.path());
  remote_.tries = 1;
  const Pyramid remote = open(server, "hangs/4");
  const std::string what = failureOf([&] { meshOf(remote, focusQuery(48, 10)); });
  EXPECT_NE(what.find("the server hangs"), std::string::npos) << what;
  EXPECT_NE(what.find("brick ("), std::string::npos) << what;
}

TEST_F(RemoteQueryTest, CancellingAndClosingWaitForNoServer) {
  build();
  const RangeServer server(folder_.path());
  remote_.stall_seconds = 60;
  for (const bool is_progressive : {false, true})
    for (const char* const behaviour : {"hangs/4", "hangs/8", "hangs/12", "hangs/20"}) {
      const auto begin = std::chrono::steady_clock::now();
      {
        // The server counts the requests of each path.
        const Pyramid remote =
            open(server, std::string(behaviour) + (is_progressive ? "/again" : "/once"));
        CancelFlag cancel;
        Query query = focusQuery(48, 10);
        query.cancel = &cancel;
        query.is_progressive = is_progressive;
        std::thread user([&] {
          std::this_thread::sleep_for(Milliseconds(300));
          cancel.request();
        });
        Extractor extractor(remote);
        try {
          CountingSink sink;
          while (!extractor.extract(query, sink).is_complete)
            extractor.waitForBricks(Milliseconds(20));
          ADD_FAILURE() << "was complete";
        } catch (const Cancelled&) {
        }
        user.join();
      }  // threads of the session wait for the server
      EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(4)) << behaviour;
    }
}

TEST_F(RemoteQueryTest, AnOpeningCanBeCancelled) {
  build();
  const RangeServer server(folder_.path());
  remote_.stall_seconds = 60;
  CancelFlag cancel;
  remote_.cancel = &cancel;
  std::thread user([&] {
    std::this_thread::sleep_for(Milliseconds(200));
    cancel.request();
  });
  EXPECT_THROW(open(server, "hangs/1"), Cancelled);
  user.join();
}

// ---- parts on disk

TEST_F(RemoteQueryTest, PartsOnDiskAreNotAskedForAgain) {
  build();
  const RangeServer server(folder_.path());
  const TemporaryFolder cache;
  remote_.cache_folder = cache.path();
  const Query query = focusQuery(48, 10);
  const std::uint64_t whole = meshOf(Pyramid(path_), query);
  {
    const Pyramid first = open(server);
    EXPECT_EQ(meshOf(first, query), whole);
    EXPECT_EQ(first.remoteCounters().cached_parts, 0u);
  }
  const Pyramid again = open(server);
  const std::uint64_t requests = again.remoteCounters().requests;
  EXPECT_EQ(meshOf(again, query), whole);
  EXPECT_EQ(again.remoteCounters().requests, requests);
  EXPECT_GT(again.remoteCounters().cached_parts, 0u);
  // A part that was damaged on disk comes from the server.
  for (const auto& entry : std::filesystem::recursive_directory_iterator(cache.path()))
    if (entry.is_regular_file()) {
      std::string bytes = readBytes(entry.path());
      if (!bytes.empty()) bytes.back() = static_cast<char>(bytes.back() ^ 1);
      writeBytes(entry.path(), bytes);
    }
  const Pyramid third = open(server);
  EXPECT_EQ(meshOf(third, query), whole);
  EXPECT_EQ(third.remoteCounters().cached_parts, 0u);
}

}  // namespace
}  // namespace isobrick::test
