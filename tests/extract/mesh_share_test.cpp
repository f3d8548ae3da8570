// Shares of surfaces: merged they are the surface of one run, and no damaged one is believed.
#include "isobrick/extract/shares/mesh_share.h"

#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <functional>
#include <random>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/shares/share_format.h"
#include "isobrick/extract/sinks/vertex_numbering.h"
#include "isobrick/storage/checksum.h"
#include "tests/extract/random_case.h"
#include "tests/support/byte_damage.h"
#include "tests/support/field_pyramid.h"
#include "tests/support/file_bytes.h"
#include "tests/support/hashing_sink.h"
#include "tests/support/repetitions.h"

namespace isobrick::test {
namespace {

BuildOptions smallBricks() {
  BuildOptions options;
  options.brick_cells = 8;
  return options;
}

void writeShare(const Pyramid& pyramid, const Query& query, const ShareNumber& share,
                const std::string& path) {
  Extractor extractor(pyramid);
  const ExtractionPlan plan = extractor.plan(query);
  const NumberRun run = bricksOf(plan, share);
  const auto sink = makeMeshShareSink(path, pyramid, plan, share);
  extractor.execute(plan, run.first, run.count, *sink);
}

std::string messageOf(const std::vector<std::string>& paths) {
  CountingSink sink;
  try {
    mergeMeshShares(paths, sink);
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

class MeshShareTest : public testing::Test {
 protected:
  static double ball(const glm::dvec3& p) { return 20 - glm::length(p - 24.0); }

  // All shares of the ball, each in a file.
  std::vector<std::string> shares(std::uint32_t of, double isovalue = 0,
                                  const std::string& name = "share") {
    Query query;
    query.isovalue = isovalue;
    std::vector<std::string> paths;
    for (std::uint32_t number = 1; number <= of; ++number) {
      paths.push_back(folder_.file(name + std::to_string(number) + ".isbm"));
      writeShare(pyramid_, query, {number, of}, paths.back());
    }
    return paths;
  }

  const TemporaryFolder folder_;
  const Pyramid pyramid_{buildField(folder_, Index3(49), ball, smallBricks())};
};

TEST_F(MeshShareTest, AnySurfaceComesOutByteByByte) {
  const char* const formats[] = {".ply", ".stl", ".obj", ".glb", ".vtp", ".3mf"};
  const int surfaces = repetitions(240);
  std::size_t bytes_compared = 0;
  for (int seed = 1; seed <= surfaces; ++seed) {
    SCOPED_TRACE("mesh " + std::to_string(seed));
    RandomCase random(static_cast<std::uint32_t>(seed));
    const TemporaryFolder folder;
    const Pyramid pyramid(buildRandomPyramid(random, folder, 2));
    Query query = randomQuery(random, pyramid);
    if (seed % 4 == 0) query.simplify = SimplifyOptions{random.real(0.1, 1)};
    query.cap = seed % 3 == 0;

    const std::string ending = formats[seed % 6];
    {
      const auto whole = makeMeshFileSink(folder.file("whole" + ending));
      extractIsosurface(pyramid, query, *whole);
    }
    // Shares are made in any order, with other budgets and numbers of threads; some may be empty.
    const auto of = static_cast<std::uint32_t>(seed % 7 == 0 ? 400 : random.uniform(1, 9));
    std::vector<std::string> paths;
    const Pyramid small(folder.file("case.isb"), 0, FileAccess::kRead);
    for (std::uint32_t number = of; number >= 1; --number) {
      paths.push_back(folder.file(std::to_string(number) + ".isbm"));
      tbb::task_arena(random.uniform(1, 4)).execute([&] {
        writeShare(random.chance(0.5) ? small : pyramid, query, {number, of}, paths.back());
      });
    }
    std::shuffle(paths.begin(), paths.end(), std::mt19937(static_cast<std::uint32_t>(seed)));
    {
      const auto merged = makeMeshFileSink(folder.file("merged" + ending));
      tbb::task_arena(random.uniform(1, 4)).execute([&] { mergeMeshShares(paths, *merged); });
    }
    const std::string expected = readBytes(folder.file("whole" + ending));
    ASSERT_TRUE(readBytes(folder.file("merged" + ending)) == expected);
    bytes_compared += expected.size();
  }
  EXPECT_GT(bytes_compared, std::size_t{6000} * static_cast<std::size_t>(surfaces));
}

TEST_F(MeshShareTest, ThePartsOfABatchAreAllThere) {
  HashingSink whole, merged;
  Query query;
  extractIsosurface(pyramid_, query, whole);
  const MergeReport report = mergeMeshShares(shares(5), merged);
  EXPECT_EQ(merged.value(), whole.value());
  EXPECT_EQ(report.triangles, whole.triangles());
  EXPECT_EQ(report.shares, 5u);
}

TEST_F(MeshShareTest, ItsBytesDependOnTheQueryAlone) {
  Query query;
  const auto bytesWith = [&](int threads) {
    tbb::task_arena(threads).execute([&] {
      writeShare(pyramid_, query, {2, 3}, folder_.file("x.isbm"));
    });
    return readBytes(folder_.file("x.isbm"));
  };
  EXPECT_TRUE(bytesWith(1) == bytesWith(4));
}

TEST_F(MeshShareTest, SharesThatAreNoWholeAreRefused) {
  std::vector<std::string> paths = shares(4);
  EXPECT_EQ(messageOf(paths), "");
  EXPECT_NE(messageOf({paths[0], paths[3]}).find("without 2/4, 3/4;"), std::string::npos);
  EXPECT_NE(messageOf({paths[1]}).find("without 1/4, 3/4, 4/4;"), std::string::npos);
  const std::string twins = messageOf({paths[2], paths[1], paths[0], paths[3], paths[2]});
  EXPECT_NE(twins.find("the same share, 3/4"), std::string::npos) << twins;
  EXPECT_NE(messageOf({}).find("no shares"), std::string::npos);

  // A share of another isovalue, of another division, of another pyramid.
  const std::string other = messageOf({paths[0], shares(4, 1.5, "other")[1], paths[2], paths[3]});
  EXPECT_NE(other.find("isovalue=1.5 (and isovalue=0 in the other)"), std::string::npos) << other;
  const std::string divided = messageOf({paths[0], shares(3, 0, "third")[1], paths[2], paths[3]});
  EXPECT_NE(divided.find("one of 3 shares"), std::string::npos) << divided;
  const Pyramid moved(buildField(
      folder_, Index3(49), [](const glm::dvec3& p) { return ball(p + 0.25); }, smallBricks(), {},
      "moved.isb"));
  writeShare(moved, Query(), {2, 4}, folder_.file("moved.isbm"));
  const std::string foreign = messageOf({paths[0], folder_.file("moved.isbm"), paths[2], paths[3]});
  EXPECT_NE(foreign.find("pyramid="), std::string::npos) << foreign;

  EXPECT_NE(messageOf({folder_.file("none.isbm")}).find("cannot open"), std::string::npos);
  EXPECT_NE(messageOf({folder_.file("field.isb")}).find("is no share"), std::string::npos);
  EXPECT_NE(messageOf({folder_.path()}).find("not a regular file"), std::string::npos);
}

TEST_F(MeshShareTest, ThereIsNoShareZero) {
  Extractor extractor(pyramid_);
  const ExtractionPlan plan = extractor.plan(Query());
  for (const ShareNumber& share :
       {ShareNumber{0, 1}, ShareNumber{2, 1}, ShareNumber{1, 0}, ShareNumber{1, kMostShares + 1}})
    EXPECT_THROW(bricksOf(plan, share), Error);
  // Each brick is in one.
  std::size_t next = 0;
  for (std::uint32_t number = 1; number <= 7; ++number) {
    const NumberRun run = bricksOf(plan, {number, 7});
    EXPECT_EQ(run.first, next);
    next += run.count;
  }
  EXPECT_EQ(next, plan.bricks().size());
}

TEST_F(MeshShareTest, NoChangedOrMissingByteIsBelieved) {
  const std::vector<std::string> paths = shares(2);
  const std::string good = readBytes(paths[1]);
  const auto expectRefused = [&](std::size_t number) {
    writeBytes(paths[1], damaged(good, number));
    ASSERT_NE(messageOf(paths), "") << "damage " << number;
  };
  for (std::size_t number = 0; number < 3 * 400; ++number) expectRefused(number);
  const std::size_t tried = forSomeDamages(good, 3000, expectRefused);
  std::printf("share of a mesh: %zu of %zu damages, all refused\n", tried, damageCount(good));
  writeBytes(paths[1], good + '\0');
  EXPECT_NE(messageOf(paths), "");
}

// With checksums that fit.
TEST_F(MeshShareTest, NoLieLeadsASinkAstray) {
  const std::vector<std::string> paths = shares(1);
  const std::string good = readBytes(paths[0]);
  using share_format::BatchRecord;
  const auto seal = [](std::string& bytes) {
    BatchRecord record;
    constexpr std::size_t kFirst = sizeof(share_format::Header);
    std::memcpy(&record, &bytes[kFirst], sizeof record);
    constexpr std::size_t kChecked = offsetof(BatchRecord, level);
    if (record.bytes >= sizeof record && record.bytes <= bytes.size() - kFirst)
      record.checksum = checksum64(&bytes[kFirst + kChecked], record.bytes - kChecked);
    std::memcpy(&bytes[kFirst], &record, sizeof record);
    share_format::Header header;
    std::memcpy(&header, bytes.data(), sizeof header);
    header.header_checksum = checksum64(&header, offsetof(share_format::Header, header_checksum));
    std::memcpy(bytes.data(), &header, sizeof header);
  };
  std::string same = good;
  seal(same);
  ASSERT_TRUE(same == good);

  std::mt19937 random(5);
  BatchRecord first;
  std::memcpy(&first, &good[sizeof(share_format::Header)], sizeof first);
  const std::size_t reach = sizeof(share_format::Header) + first.bytes;
  const int rounds = repetitions(3000);
  int refused = 0;
  for (int round = 0; round < rounds; ++round) {
    std::string bad = good;
    const std::size_t within = round % 2 == 0 ? sizeof(share_format::Header) + sizeof first : reach;
    const std::size_t at = random() % (within - 7);
    const std::uint64_t lies[] = {0, ~std::uint64_t{0}, std::uint64_t{1} << (random() % 64),
                                  random()};
    std::memcpy(&bad[at], &lies[random() % 4], 1 + random() % 8);
    seal(bad);
    writeBytes(paths[0], bad);
    refused += messageOf(paths).empty() ? 0 : 1;
    const auto file = makeMeshFileSink(folder_.file("out.glb"));
    try {
      mergeMeshShares(paths, *file);
    } catch (const Error&) {
    }
  }
  EXPECT_GT(refused, rounds / 3);
}

TEST_F(MeshShareTest, AFailureAndARequestToStopReachTheCaller) {
  const std::vector<std::string> paths = shares(3);
  struct Full : CountingSink {
    void write(PlacedBatch&) override { throw ResumableError("the disk is full"); }
  } full;
  EXPECT_THROW(mergeMeshShares(paths, full), ResumableError);
  CancelFlag cancel;
  struct Asking : CountingSink {
    explicit Asking(CancelFlag& of) : flag(of) {}
    void place(PlacedBatch& placed) override {
      CountingSink::place(placed);
      flag.request();
    }
    void finish() override { ADD_FAILURE() << "finished"; }
    CancelFlag& flag;
  } asking(cancel);
  EXPECT_THROW(mergeMeshShares(paths, asking, &cancel), Cancelled);
  // A share that is not finished has no name.
  {
    Extractor extractor(pyramid_);
    const ExtractionPlan plan = extractor.plan(Query());
    const auto sink = makeMeshShareSink(folder_.file("half.isbm"), pyramid_, plan, {});
  }
  EXPECT_FALSE(std::filesystem::exists(folder_.file("half.isbm")));
}

}  // namespace
}  // namespace isobrick::test
