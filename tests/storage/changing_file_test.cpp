// A file that is cut, or written to, while a pyramid of it is open: what comes out is right, or an
// Error that names the brick.

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <string>
#include <thread>

#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid.h"
#include "isobrick/storage/pyramid_parts.h"
#include "isobrick/storage/pyramid_verify.h"
#include "tests/support/child_process.h"
#include "tests/support/every_brick.h"
#include "tests/support/file_edits.h"
#include "tests/support/noise_pyramid.h"
#include "tests/support/plain_bricks.h"
#include "tests/support/plain_reader.h"
#include "tests/support/random_numbers.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

volatile std::uint64_t g_changing_sink;  // keeps reads from being optimised away

// Reads all samples of the brick; 0: read, 1: an Error that names it, 2: another Error.
int readBrick(const Pyramid& pyramid, int level, const Index3& brick) {
  try {
    const BrickSamples samples = pyramid.samples(level, brick);
    const std::size_t bytes =
        static_cast<std::size_t>(samples.box.size()) * voxelBytes(pyramid.spec().voxel_type);
    std::uint64_t sum = 0;
    for (std::size_t i = 0; i < bytes; ++i)
      sum += static_cast<std::uint8_t>(samples.part.data()[i]);
    g_changing_sink = sum;
    return 0;
  } catch (const Error& error) {
    return std::string(error.what()).find(brickName(level, brick)) != std::string::npos ? 1 : 2;
  }
}

void checkBricksNotYetReadThrow(format::Codec codec) {
  const DiskFolder folder;
  const std::string path = buildPagedFile(folder, codec);
  // Between the parts of two bricks.
  const PlainPyramid plain = readPlainPyramid(path);
  const PlainPart& first_lost = plain.bricks[plain.bricks.size() / 2].parts[0];
  ASSERT_GT(first_lost.offset, 0u);
  expectChildLeavesWith(0, [&] {
    const Pyramid pyramid(path);
    std::filesystem::resize_file(path, first_lost.offset);
    int read = 0, failed = 0, wrong = 0;
    forAllBricks(pyramid, [&](int level, const Index3& brick) {
      const int result = readBrick(pyramid, level, brick);
      (result == 0 ? read : result == 1 ? failed : wrong) += 1;
      // verifyBrick says the same.
      if (verifyBrick(pyramid, level, brick).has_value() != (result == 1)) ++wrong;
    });
    return read > 0 && failed > 0 && wrong == 0 ? 0 : 3;
  });
}

TEST(TruncatedWhileMapped, BricksNotYetReadThrow) {
  for (const format::Codec codec : kCodecs) checkBricksNotYetReadThrow(codec);
}

// The pager knows the brick as resident; the pages behind it are gone all the same.
void checkBricksReadBeforeThrow(format::Codec codec) {
  const DiskFolder folder;
  const std::string path = buildPagedFile(folder, codec);
  expectChildLeavesWith(0, [&] {
    const Pyramid pyramid(path);
    forAllBricks(pyramid,
                 [&](int level, const Index3& brick) { readBrick(pyramid, level, brick); });
    std::filesystem::resize_file(path, 4096);
    int failed = 0, wrong = 0;
    forAllBricks(pyramid, [&](int level, const Index3& brick) {
      (readBrick(pyramid, level, brick) == 1 ? failed : wrong) += 1;
    });
    return failed > 0 && wrong == 0 ? 0 : 3;
  });
}

TEST(TruncatedWhileMapped, BricksReadBeforeThrow) {
  for (const format::Codec codec : kCodecs) checkBricksReadBeforeThrow(codec);
}

// A brick that is held at that moment reads as zeros, and its user is told.
TEST(TruncatedWhileMapped, HeldBricksAreErrorsAfterTheirUse) {
  const DiskFolder folder;
  const std::string path = buildPagedFile(folder);
  expectChildLeavesWith(0, [&] {
    const Pyramid pyramid(path);
    const Index3 last = pyramid.layout().bricks(0) - Index3(1);
    const BrickSamples samples = pyramid.samples(0, last);
    pyramid.throwIfReadsFailed(0, last);  // all is well so far
    std::filesystem::resize_file(path, 512);
    g_changing_sink = static_cast<std::uint8_t>(samples.part.data()[0]);
    try {
      pyramid.throwIfReadsFailed(0, last);
    } catch (const Error& error) {
      return std::string(error.what()).find(brickName(0, last)) != std::string::npos ? 0 : 4;
    }
    return 3;
  });
}

// Unpacked samples do not change with the file.
TEST(TruncatedWhileMapped, HeldPackedBricksStay) {
  const DiskFolder folder;
  const std::string path = buildPagedFile(folder, format::Codec::kZstd);
  const PlainPyramid plain = readPlainPyramid(path);
  expectChildLeavesWith(0, [&] {
    const Pyramid pyramid(path);
    const PlainBrick& brick = plain.bricks.front();
    const BrickSamples samples = pyramid.samples(0, Index3(0));
    if (pyramid.parts().storedBytes(PartKind::kSamples, 0, Index3(0)) >= 2 * brick.samples.size())
      return 4;  // not packed
    std::filesystem::resize_file(path, 512);
    if (!areSamplesOf<std::uint16_t>(brick, samples)) return 3;
    pyramid.throwIfReadsFailed(0, Index3(0));
    return readBrick(pyramid, 0, Index3(0)) == 1 ? 0 : 5;
  });
}

// The file is cut at any moment of reading, checking and unpacking. Returns the number of errors,
// -1 if samples were wrong and no error said so.
int readWhileCut(const PlainPyramid& plain, const std::string& path, std::uint64_t spins) {
  const Pyramid pyramid(path, 64 * 1024);
  std::atomic<bool> is_cut{false};
  std::thread cutter([&] {
    for (std::uint64_t i = 0; i < spins; ++i) g_changing_sink = i;
    std::filesystem::resize_file(path, 4096);
    is_cut = true;
  });
  int errors = 0;
  bool is_wrong = false;
  for (bool is_last = false; !is_last && !is_wrong;) {
    is_last = is_cut;  // once more over all bricks after the cut
    for (const PlainBrick& brick : plain.bricks) try {
        const BrickSamples samples = pyramid.samples(brick.level, indexOf(brick));
        const bool is_right = areSamplesOf<std::uint16_t>(brick, samples);
        pyramid.throwIfReadsFailed(brick.level, indexOf(brick));
        is_wrong = is_wrong || !is_right;
      } catch (const Error&) {
        ++errors;
      }
  }
  cutter.join();
  return is_wrong ? -1 : errors;
}

TEST(TruncatedWhileMapped, BricksAreRightOrErrorsWheneverTheFileIsCut) {
  const DiskFolder folder;
  for (const format::Codec codec : kCodecs) {
    SCOPED_TRACE(codecName(codec));
    const std::string path = buildPagedFile(folder, codec);
    const Bytes good = readWholeFile(path);
    const PlainPyramid plain = readPlainPyramid(path);
    expectChildLeavesWith(0, [&] {
      Random random(16);
      int errors = 0;
      for (int round = 0; round < 60; ++round) {
        writeBytes(path, good);
        const int result = readWhileCut(plain, path, randomBelow(random, 1000000));
        if (result < 0) return 3;
        errors += result;
      }
      return errors > 0 ? 0 : 4;
    });
  }
}

// A thread changes bytes of a packed part, and back again, all the time. A decoder that read the
// bytes after their checksum would see others.
void readWhileWritten(format::Codec codec) {
  const DiskFolder folder;
  const std::string path = buildPagedFile(folder, codec);
  const PlainPyramid plain = readPlainPyramid(path);
  const PlainBrick& brick = plain.bricks.front();
  const PlainPart& part = brick.parts[0];
  ASSERT_EQ(part.codec, static_cast<std::uint32_t>(codec));
  const int fd = open(path.c_str(), O_RDWR | O_CLOEXEC);
  void* const map = mmap(nullptr, plain.file_bytes, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
  close(fd);
  ASSERT_NE(map, MAP_FAILED);
  auto* const bytes = static_cast<volatile std::uint8_t*>(map) + part.offset;
  std::atomic<bool> stop{false};
  std::thread writer([&] {
    Random random(31);
    while (!stop) {
      // Blosc's header and table of blocks, or the stream.
      const std::uint64_t at =
          random() % 2 == 0 ? randomBelow(random, 24) : randomBelow(random, part.stored_bytes);
      const std::uint8_t good = bytes[at];
      bytes[at] = static_cast<std::uint8_t>(good ^ (1 << random() % 8));
      for (std::uint64_t spins = randomBelow(random, 8000); spins > 0; --spins)
        g_changing_sink = spins;
      bytes[at] = good;
      for (std::uint64_t spins = randomBelow(random, 8000); spins > 0; --spins)
        g_changing_sink = spins;
    }
  });
  int right = 0, errors = 0, wrong = 0;
  const Pyramid pyramid(path, 0);  // every time from the file
  for (int round = 0; round < 40000 && wrong == 0; ++round) try {
      const BrickSamples samples = pyramid.samples(0, Index3(0));
      ++(areSamplesOf<std::uint16_t>(brick, samples) ? right : wrong);
    } catch (const Error&) {
      ++errors;
    }
  stop = true;
  writer.join();
  munmap(map, plain.file_bytes);
  EXPECT_GT(right, 100);
  EXPECT_GT(errors, 100);
  EXPECT_EQ(wrong, 0) << codecName(codec) << ", after " << right << " right and " << errors
                      << " errors";
}

TEST(WrittenWhileOpen, PackedBricksAreRightOrErrors) {
  readWhileWritten(format::Codec::kLz4);
  readWhileWritten(format::Codec::kZstd);
}

}  // namespace
}  // namespace isobrick::test
