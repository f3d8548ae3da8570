// Files that fail, are cut or written to while queries run: what needs the lost bytes ends in an
// Error that names a brick and an offset, and all other queries of the process go on.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/indexed_mesh.h"
#include "isobrick/extract/sinks/vertex_numbering.h"
#include "isobrick/preprocess/phantoms/phantom.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/storage/pyramid_parts.h"
#include "isobrick/storage/pyramid_verify.h"
#include "tests/extract/read_faults.h"
#include "tests/support/file_bytes.h"
#include "tests/support/plain_reader.h"
#include "tests/support/random_numbers.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

using format::Codec;

struct Storing {
  const char* name;
  Codec codec;
  FileAccess access;
};

// A head of 4^3 bricks at level 0, the back half of which fails.
class FailingFile : public testing::TestWithParam<Storing> {
 protected:
  static constexpr std::int64_t kFirstBackBrick = 2;  // by its z

  void SetUp() override {
    BuildOptions options;
    options.brick_cells = 16;
    options.codec = GetParam().codec;
    buildPyramid(*makePhantomSource(PhantomSpec{"head", 64, {}, 16}), path_, options);
    for (const PlainBrick& brick : readPlainPyramid(path_).bricks) {
      if (brick.level > 0) continue;
      for (const PlainPart& part : brick.parts) {
        if (part.stored_bytes == 0) continue;
        if (brick.index[2] >= kFirstBackBrick) {
          back_begin_ = std::min(back_begin_, part.offset);
          back_is_in_place_ = back_is_in_place_ || (part.codec == 0 && isMapped());
        }
        back_end_ = std::max(back_end_, part.offset + part.stored_bytes);
      }
    }
    good_ = readBytes(path_);
    all_ = meshOf(Pyramid(path_), wholeQuery());
    front_ = meshOf(Pyramid(path_), frontQuery());
    ASSERT_FALSE(front_.triangles.empty());
    ASSERT_GT(all_.triangles.size(), front_.triangles.size());
  }

  static bool isMapped() { return GetParam().access == FileAccess::kMap; }

  static Query wholeQuery() {
    Query query;
    query.isovalue = 500;
    return query;
  }
  // Needs no byte of the back.
  static Query frontQuery() {
    Query query = wholeQuery();
    query.box = QueryBox{glm::dvec3(-1), glm::dvec3(200, 200, 16 * kFirstBackBrick)};
    return query;
  }
  static IndexedMesh meshOf(const Pyramid& pyramid, const Query& query) {
    IndexedMeshSink sink;
    extractIsosurface(pyramid, query, sink);
    return sink.takeMesh();
  }
  static bool isSame(const IndexedMesh& a, const IndexedMesh& b) {
    return a.positions == b.positions && a.normals == b.normals && a.triangles == b.triangles;
  }

  // That it names path, brick and offset of the back.
  void expectNamesBack(const Error& error) const {
    const std::string text = error.what();
    EXPECT_EQ(error.place().path, path_) << text;
    EXPECT_EQ(error.place().level, 0) << text;
    ASSERT_TRUE(error.place().brick.has_value() && error.place().offset.has_value()) << text;
    EXPECT_GE(error.place().brick->z, kFirstBackBrick) << text;
    EXPECT_GE(*error.place().offset, back_begin_ / 4096 * 4096) << text;
    EXPECT_NE(text.find("brick ("), std::string::npos) << text;
    EXPECT_NE(text.find("offset " + std::to_string(*error.place().offset)), std::string::npos)
        << text;
    EXPECT_EQ(text.find('\n'), std::string::npos) << text;
  }
  void expectBackFails(const Pyramid& pyramid) const {
    CountingSink sink;
    SurfaceMesh mesh;
    for (const auto& extract :
         {std::function<void()>([&] { extractIsosurface(pyramid, wholeQuery(), sink); }),
          std::function<void()>([&] { extractIsosurface(pyramid, wholeQuery(), mesh); })})
      try {
        extract();
        ADD_FAILURE() << "a query of bytes that are not there has succeeded";
      } catch (const Error& error) {
        expectNamesBack(error);
      }
  }

  // Runs queries that need the back on `pyramid` in this thread, those of the front on the same
  // pyramid in one, and those of another file in another.
  void expectOnlyTheBackFails(const Pyramid& pyramid) const {
    const std::string other_path = folder_.file("other.isb");
    writeBytes(other_path, good_);
    const Pyramid other(other_path);
    std::atomic<bool> stops{false};
    std::atomic<int> good{0}, bad{0};
    std::string message;
    std::vector<std::thread> threads;
    const auto repeat = [&](const Pyramid& of, const Query& query, const IndexedMesh& expected) {
      Extractor extractor(of);
      do {
        IndexedMeshSink sink;
        try {
          extractor.extract(query, sink);
          (isSame(sink.mesh(), expected) ? good : bad) += 1;
        } catch (const Error& error) {
          if (bad++ == 0) message = error.what();
        }
      } while (!stops);
    };
    threads.emplace_back([&] { repeat(pyramid, frontQuery(), front_); });
    threads.emplace_back([&] { repeat(other, wholeQuery(), all_); });
    for (int round = 0; round < 3; ++round) expectBackFails(pyramid);
    stops = true;
    for (std::thread& thread : threads) thread.join();
    EXPECT_EQ(bad, 0) << message;
    EXPECT_GE(good, 2);
    EXPECT_TRUE(isSame(meshOf(pyramid, frontQuery()), front_));
  }

  // The bytes of the back, in place.
  void writeBack(const std::string& bytes) const {
    const int fd = open(path_.c_str(), O_WRONLY | O_CLOEXEC);
    const ssize_t done = pwrite(fd, bytes.data(), bytes.size(), static_cast<off_t>(back_begin_));
    close(fd);
    ASSERT_EQ(done, static_cast<ssize_t>(bytes.size()));
  }
  std::string goodBack() const { return good_.substr(back_begin_, back_end_ - back_begin_); }
  std::string otherBack() const {
    std::string bytes = goodBack();
    for (char& byte : bytes) byte = static_cast<char>(byte ^ 0x11);
    return bytes;
  }
  // With the ranges as they were.
  std::string otherBackSamples() const {
    std::string bytes = goodBack();
    for (const PlainBrick& brick : readPlainPyramid(path_).bricks) {
      const PlainPart& samples = brick.parts[0];
      if (brick.level > 0 || brick.index[2] < kFirstBackBrick || samples.stored_bytes == 0)
        continue;
      bytes[samples.offset - back_begin_] ^= 0x11;
    }
    return bytes;
  }

  const TemporaryFolder folder_;
  const std::string path_ = folder_.file("head.isb");
  std::uint64_t back_begin_ = ~std::uint64_t{0}, back_end_ = 0;
  bool back_is_in_place_ = false;  // some of it
  std::string good_;
  IndexedMesh all_, front_;
};

// Files whose samples are used in place, files of which they are copied, and those of which all is.
class FailingFileInPlace : public FailingFile {};
class FailingFileCopied : public FailingFile {};
class FailingFileUnmapped : public FailingFile {};

TEST_P(FailingFileCopied, AnIoErrorEndsTheQueriesThatNeedTheBytes) {
  const Pyramid pyramid(path_, Pyramid::kDefaultBudgetBytes, GetParam().access);
  {
    const FaultyReads fault(path_, ReadFault::kIoError, back_begin_, back_end_);
    expectOnlyTheBackFails(pyramid);
    EXPECT_GT(FaultyReads::count(), 0u);
  }
  EXPECT_TRUE(isSame(meshOf(pyramid, wholeQuery()), all_));
}

TEST_P(FailingFileCopied, AFileThatEndsEarlyEndsTheQueriesThatNeedMore) {
  const Pyramid pyramid(path_, Pyramid::kDefaultBudgetBytes, GetParam().access);
  {
    const FaultyReads fault(path_, ReadFault::kEndOfFile, back_begin_, back_end_);
    expectOnlyTheBackFails(pyramid);
    EXPECT_GT(FaultyReads::count(), 0u);
  }
  EXPECT_TRUE(isSame(meshOf(pyramid, wholeQuery()), all_));
}

TEST_P(FailingFile, ReadsThatAreShortOrInterruptedGoOn) {
  for (const ReadFault kind : {ReadFault::kFewBytes, ReadFault::kInterrupted}) {
    const FaultyReads fault(path_, kind);
    const Pyramid pyramid(path_, Pyramid::kDefaultBudgetBytes, GetParam().access);
    EXPECT_TRUE(isSame(meshOf(pyramid, wholeQuery()), all_));
    EXPECT_GT(FaultyReads::count(), 0u);
  }
}

TEST_P(FailingFile, ACutEndsTheQueriesThatNeedTheBytes) {
  const Pyramid pyramid(path_, 16 * 20 * 20 * 20 * 2, GetParam().access);
  const Index3 last = pyramid.layout().bricks(0) - Index3(2);
  std::filesystem::resize_file(path_, back_begin_);
  expectOnlyTheBackFails(pyramid);
  EXPECT_THROW(pyramid.samples(0, last), Error);
}

// Pages of the back fail while they are in use.
TEST_P(FailingFileInPlace, AHeldBrickThatIsCutFailsAlone) {
  const Pyramid pyramid(path_, Pyramid::kDefaultBudgetBytes, GetParam().access);
  const Index3 brick = pyramid.layout().bricks(0) - Index3(2);
  ASSERT_GT(pyramid.parts().storedBytes(PartKind::kSamples, 0, brick), 4096u);
  const BrickSamples held = pyramid.samples(0, brick);
  std::filesystem::resize_file(path_, back_begin_);
  EXPECT_EQ(static_cast<int>(*held.part.data()), 0);
  try {
    pyramid.throwIfReadsFailed(0, brick);
    ADD_FAILURE() << "nobody heard of the cut";
  } catch (const Error& error) {
    expectNamesBack(error);
  }
  expectOnlyTheBackFails(pyramid);
}

// Whatever is lost at whatever moment: the mesh is right, or the Error speaks of reading and does
// not call the file contradictory.
TEST_P(FailingFile, ACutAtAnyMomentIsCalledACut) {
  Query mixed = wholeQuery();
  mixed.focus = FocusSphere{glm::dvec3(32), 12};
  const IndexedMesh mixed_mesh = meshOf(Pyramid(path_), mixed);
  Random random(7);
  int errors = 0;
  for (int round = 0; round < 32; ++round) {
    writeBytes(path_, good_);
    // Copies would survive the cut.
    const Pyramid pyramid(path_, isMapped() ? Pyramid::kDefaultBudgetBytes : 0, GetParam().access);
    const bool is_mixed = round % 2 == 0;
    if (round % 4 < 2) meshOf(pyramid, is_mixed ? mixed : wholeQuery());  // all is resident
    const auto wait = std::chrono::microseconds(randomBelow(random, 10000));
    std::thread cutter([&] {
      std::this_thread::sleep_for(wait);
      std::filesystem::resize_file(path_, 4096);
    });
    try {
      for (int repeat = 0; repeat < 10; ++repeat) {
        if (is_mixed) {
          ASSERT_TRUE(isSame(meshOf(pyramid, mixed), mixed_mesh));
        } else {
          SurfaceMesh mesh;
          extractIsosurface(pyramid, wholeQuery(), mesh);
          ASSERT_EQ(mesh.triangles().size(), all_.triangles.size());
        }
      }
    } catch (const Error& error) {
      ++errors;
      const std::string text = error.what();
      EXPECT_EQ(text.find("contradicts"), std::string::npos) << text;
      EXPECT_NE(text.find("brick ("), std::string::npos) << text;
      EXPECT_NE(text.find("offset"), std::string::npos) << text;
    }
    cutter.join();
  }
  EXPECT_GT(errors, 10);
}

TEST_P(FailingFile, AFileThatIsReplacedUnderItsNameStaysWhatItWas) {
  const Pyramid pyramid(path_, 4 * 20 * 20 * 20 * 2, GetParam().access);
  const IndexedMesh before = meshOf(pyramid, wholeQuery());
  writeBytes(folder_.file("new"), std::string(good_.size(), '\x55'));
  std::filesystem::rename(folder_.file("new"), path_);
  EXPECT_TRUE(isSame(meshOf(pyramid, wholeQuery()), before));
  EXPECT_TRUE(isSame(meshOf(pyramid, frontQuery()), front_));
}

// Also if all parts are resident: what is used in place has changed with the file.
TEST_P(FailingFile, WhatIsWrittenOverIsNoticed) {
  for (const std::uint64_t budget : {std::uint64_t{0}, Pyramid::kDefaultBudgetBytes}) {
    const Pyramid pyramid(path_, budget, GetParam().access);
    EXPECT_TRUE(isSame(meshOf(pyramid, wholeQuery()), all_));
    writeBack(otherBack());
    if (back_is_in_place_ || budget == 0)
      expectOnlyTheBackFails(pyramid);
    else
      EXPECT_TRUE(isSame(meshOf(pyramid, wholeQuery()), all_));  // copied before
    writeBack(goodBack());
    EXPECT_TRUE(isSame(meshOf(pyramid, wholeQuery()), all_));
  }
}

// Does something when the fifth brick was meshed, and something else when the eighth was.
class InterruptingSink : public IndexedMeshSink {
 public:
  InterruptingSink(std::function<void()> fifth, std::function<void()> eighth)
      : fifth_(std::move(fifth)), eighth_(std::move(eighth)) {}
  void place(PlacedBatch& placed) override {
    if (++batches_ == 5) fifth_();
    if (batches_ == 8) eighth_();
    IndexedMeshSink::place(placed);
  }
  void finish() override { is_finished = true; }
  bool is_finished = false;

 private:
  std::function<void()> fifth_, eighth_;
  int batches_ = 0;
};

TEST_P(FailingFileInPlace, WhatIsWrittenOverWhileItIsMeshedIsNoticed) {
  const Pyramid pyramid(path_);
  meshOf(pyramid, wholeQuery());
  InterruptingSink sink([&] { writeBack(otherBack()); }, [] {});
  try {
    extractIsosurface(pyramid, wholeQuery(), sink);
    ADD_FAILURE() << "samples that somebody wrote over were taken for those of the file";
  } catch (const Error& error) {
    expectNamesBack(error);
  }
  EXPECT_FALSE(sink.is_finished);
  writeBack(goodBack());
  EXPECT_TRUE(isSame(meshOf(pyramid, wholeQuery()), all_));
}

// Also if it takes no read to have it.
TEST_P(FailingFileInPlace, WhatIsWrittenOverFailsAProgressiveQuery) {
  const Pyramid pyramid(path_);
  Extractor extractor(pyramid);
  Query query = wholeQuery();
  query.is_progressive = true;
  const auto refine = [&] {
    CountingSink sink;
    for (std::size_t answer = 0; answer < pyramid.brickCount(); ++answer) {
      if (extractor.extract(query, sink).is_complete) return true;
      extractor.waitForBricks(std::chrono::seconds(10));
    }
    return false;
  };
  ASSERT_TRUE(refine());
  writeBack(otherBackSamples());
  try {
    refine();
    ADD_FAILURE() << "nothing was wrong";
  } catch (const Error& error) {
    expectNamesBack(error);
  }
  writeBack(goodBack());
  EXPECT_TRUE(refine());
}

// All is as it was when the query ends, but nobody knows what the meshers saw.
TEST_P(FailingFileInPlace, WhatIsWrittenOverForAMomentIsNoticed) {
  const Pyramid pyramid(path_);
  meshOf(pyramid, wholeQuery());
  InterruptingSink sink([&] { writeBack(otherBack()); }, [&] { writeBack(goodBack()); });
  EXPECT_THROW(extractIsosurface(pyramid, wholeQuery(), sink), Error);
  EXPECT_FALSE(sink.is_finished);
  EXPECT_TRUE(isSame(meshOf(pyramid, wholeQuery()), all_));
}

// Meshes of every kind, within a budget that makes parts go and come.
TEST_P(FailingFileUnmapped, WhatIsReadGivesTheSameAsTheMap) {
  for (const std::uint64_t budget : {std::uint64_t{200000}, Pyramid::kDefaultBudgetBytes}) {
    const Pyramid read(path_, budget, FileAccess::kRead);
    const Pyramid mapped(path_, budget);
    Query mixed = wholeQuery();
    mixed.focus = FocusSphere{glm::dvec3(28), 8};
    Query flat = wholeQuery();
    flat.curvature_tolerance = 0.02;
    for (const Query& query : {wholeQuery(), mixed, flat}) {
      const IndexedMesh mesh = meshOf(read, query);
      EXPECT_FALSE(mesh.triangles.empty());
      EXPECT_TRUE(isSame(mesh, meshOf(mapped, query)));
    }
    EXPECT_GT(read.parts().counters().bytes_read, 0u);
    for (std::size_t row = 0; row < read.brickCount(); ++row) {
      const BrickAddress at = read.parts().brickAt(row);
      EXPECT_FALSE(verifyBrick(read, at.level, at.brick).has_value());
    }
    EXPECT_TRUE(verifyRest(read).empty());
  }
}

TEST_P(FailingFile, NothingIsMappedOfAFileThatIsRead) {
  const Pyramid pyramid(path_, Pyramid::kDefaultBudgetBytes, GetParam().access);
  meshOf(pyramid, wholeQuery());
  const bool is_mapped = readBytes("/proc/self/maps").find(path_) != std::string::npos;
  EXPECT_EQ(is_mapped, isMapped());
}

constexpr Storing kStored{"Stored", Codec::kStored, FileAccess::kMap};
constexpr Storing kPacked{"Packed", Codec::kZstd, FileAccess::kMap};
constexpr Storing kReadStored{"ReadStored", Codec::kStored, FileAccess::kRead};
constexpr Storing kReadPacked{"ReadPacked", Codec::kZstd, FileAccess::kRead};

std::string nameOf(const testing::TestParamInfo<Storing>& test) { return test.param.name; }

INSTANTIATE_TEST_SUITE_P(All, FailingFile,
                         testing::Values(kStored, kPacked, kReadStored, kReadPacked), nameOf);
INSTANTIATE_TEST_SUITE_P(All, FailingFileInPlace, testing::Values(kStored), nameOf);
INSTANTIATE_TEST_SUITE_P(All, FailingFileCopied, testing::Values(kPacked, kReadStored, kReadPacked),
                         nameOf);
INSTANTIATE_TEST_SUITE_P(All, FailingFileUnmapped, testing::Values(kReadStored, kReadPacked),
                         nameOf);

}  // namespace
}  // namespace isobrick::test
