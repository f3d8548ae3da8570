// Files that came to harm: flipped bits, ends that are missing, other files. Each damage is found,
// and costs no more than the brick that it lies in.

#include <gtest/gtest.h>

#include <bit>
#include <cstdint>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid.h"
#include "isobrick/storage/pyramid_parts.h"
#include "tests/support/every_brick.h"
#include "tests/support/file_edits.h"
#include "tests/support/noise_pyramid.h"
#include "tests/support/plain_bricks.h"
#include "tests/support/plain_reader.h"
#include "tests/support/pyramid_verdict.h"
#include "tests/support/random_numbers.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

TEST(DamagedFile, TheGoodFileIsGood) {
  const TemporaryFolder folder;
  for (const format::Codec codec : kCodecs)
    for (int type = 0; type < 5; ++type) {
      const std::string path = buildGoodFile(folder, static_cast<VoxelType>(type), codec);
      EXPECT_TRUE(judge(path).isGood());
      bool has[3][5] = {};
      const PlainPyramid plain = readPlainPyramid(path);
      for (const PlainBrick& brick : plain.bricks)
        for (std::size_t part = 0; part < 3; ++part) has[part][brick.parts[part].codec] = true;
      // The fixture must have every kind of part, or the tests below look at less than they say.
      EXPECT_TRUE(has[0][1] && has[1][1] && has[2][1] && has[2][2]);
      if (codec == format::Codec::kStored) {
        EXPECT_TRUE(has[0][0] && has[1][0] && has[2][0]);
      } else if (voxelBytes(static_cast<VoxelType>(type)) > 1) {
        EXPECT_TRUE(has[0][static_cast<std::size_t>(codec)]);
      }
    }
}

TEST(DamagedFile, EveryFlippedBitOfATinyFileIsFound) {
  const TemporaryFolder folder;
  const std::string path = buildTinyFile(folder);
  const Bytes good = readWholeFile(path);
  const std::vector<bool> covered = readPlainPyramid(path).covered;
  const std::string bad = folder.file("bad.isb");
  for (std::size_t at = 0; at < good.size(); ++at)
    for (int bit = 0; bit < 8; ++bit) {
      Bytes bytes = good;
      bytes[at] ^= static_cast<std::uint8_t>(1 << bit);
      writeBytes(bad, bytes);
      const Verdict verdict = judge(bad);
      ASSERT_FALSE(verdict.isGood()) << "byte " << at << " bit " << bit;
      // Padding has no meaning, so the file can be used; everything else is under a checksum.
      if (covered[at]) continue;
      ASSERT_TRUE(verdict.open_error.empty() && verdict.damaged.empty());
      ASSERT_NE(verdict.rest.front().find("offset " + std::to_string(at)), std::string::npos)
          << verdict.rest.front();
    }
}

TEST(DamagedFile, EveryPrefixOfATinyFileIsRefused) {
  const TemporaryFolder folder;
  const Bytes good = readWholeFile(buildTinyFile(folder));
  const std::string bad = folder.file("bad.isb");
  for (std::size_t length = 0; length < good.size(); ++length) {
    writeBytes(bad, Bytes(good.begin(), good.begin() + static_cast<std::ptrdiff_t>(length)));
    ASSERT_NE(judge(bad).open_error, "") << length << " bytes";
  }
  Bytes longer = good;
  longer.push_back(0);
  writeBytes(bad, longer);
  EXPECT_NE(judge(bad).open_error, "");
}

TEST(DamagedFile, TruncatedFilesAreRefused) {
  const TemporaryFolder folder;
  const Bytes good = readWholeFile(buildGoodFile(folder));
  const std::string bad = folder.file("bad.isb");
  for (std::size_t length = 0; length < good.size(); length += 1 + length / 40) {
    writeBytes(bad, Bytes(good.begin(), good.begin() + static_cast<std::ptrdiff_t>(length)));
    ASSERT_NE(judge(bad).open_error, "") << length << " bytes";
  }
}

TEST(DamagedFile, EveryFlippedByteOfHeaderAndTablesIsFound) {
  const TemporaryFolder folder;
  const std::string path = buildGoodFile(folder);
  const Bytes good = readWholeFile(path);
  const PlainPyramid plain = readPlainPyramid(path);
  const std::string bad = folder.file("bad.isb");
  const auto flipped = [&](std::uint64_t at) {
    Bytes bytes = good;
    bytes[at] ^= 0xff;
    writeBytes(bad, bytes);
    return judge(bad);
  };
  const auto mustNotOpen = [&](std::uint64_t first, std::uint64_t count) {
    for (std::uint64_t at = first; at < first + count; ++at)
      ASSERT_NE(flipped(at).open_error, "") << "byte " << at;
  };
  mustNotOpen(0, 512);
  mustNotOpen(plain.level_table_offset, plain.levels.size() * kLevelRowBytes);
  mustNotOpen(plain.provenance_offset, plain.provenance.size());
  // A row is looked at when its brick is asked for, the histogram and the gradients when they are.
  for (std::uint64_t i = 0; i < plain.bricks.size() * kBrickRowBytes; ++i)
    ASSERT_EQ(flipped(plain.brick_table_offset + i).damaged,
              (std::vector<std::size_t>{i / kBrickRowBytes}))
        << "byte " << i << " of the table";
  constexpr std::uint64_t kHistogramAt = 272, kGradientsAt = 368;
  for (const auto& [at, name] : {std::pair{kHistogramAt, "damaged histogram"},
                                 std::pair{kGradientsAt, "damaged gradient"}}) {
    const std::uint64_t first = getU64(good, at);
    const std::uint64_t count = getU64(good, at + 16) % (std::uint64_t{1} << 32);
    ASSERT_GT(count, 0u) << name;
    for (std::uint64_t i = 0; i < count; ++i) {
      const Verdict verdict = flipped(first + i);
      ASSERT_EQ(verdict.rest.size(), 1u) << name << ", byte " << i;
      ASSERT_NE(verdict.rest.front().find(name), std::string::npos) << "byte " << i;
    }
  }
}

// Every byte of every part: verifyBrick of the brick that owns it finds it, no other brick does,
// and asking for the part is an Error that names brick and level.
void flipEveryByteOfBricks(format::Codec codec) {
  const TemporaryFolder folder;
  const std::string path = buildGoodFile(folder, VoxelType::kUint16, codec);
  const Bytes good = readWholeFile(path);
  const PlainPyramid plain = readPlainPyramid(path);
  const std::string bad = folder.file("bad.isb");
  Random random(12);
  std::size_t flips = 0;
  for (std::size_t row = 0; row < plain.bricks.size(); ++row)
    for (std::size_t kind = 0; kind < 3; ++kind) {
      const PlainPart& part = plain.bricks[row].parts[kind];
      // Every byte of some bricks, ends and random bytes of the others.
      std::vector<std::uint64_t> places;
      if (row % 9 == 0) {
        places.resize(part.stored_bytes);
        std::iota(places.begin(), places.end(), std::uint64_t{0});
      } else if (part.stored_bytes > 0) {
        places = {0, part.stored_bytes - 1ull, randomBelow(random, part.stored_bytes)};
      }
      for (const std::uint64_t place : places) {
        Bytes bytes = good;
        bytes[part.offset + place] ^= static_cast<std::uint8_t>(1 << (flips++ % 8));
        writeBytes(bad, bytes);
        const Verdict verdict = judge(bad);
        ASSERT_EQ(verdict.open_error, "");
        ASSERT_EQ(verdict.damaged, (std::vector<std::size_t>{row}))
            << "part " << kind << " byte " << place;
        const PlainBrick& brick = plain.bricks[row];
        const Index3 index = indexOf(brick);
        const Pyramid pyramid(bad);
        std::string message;
        try {
          std::vector<ValueRange> ranges;
          std::vector<std::uint8_t> codes;
          if (kind == 0) pyramid.samples(brick.level, index);
          if (kind == 1) pyramid.tileRanges(brick.level, index, ranges);
          if (kind == 2) pyramid.parts().curvature(index, codes);
        } catch (const Error& error) {
          message = error.what();
        }
        ASSERT_NE(message.find(brickName(brick.level, index)), std::string::npos)
            << "'" << message << "' lacks " << brickName(brick.level, index);
        ASSERT_NE(message.find(bad), std::string::npos) << message;
      }
    }
  EXPECT_GT(flips, 500u);
}

TEST(DamagedFile, EveryFlippedByteInAStoredBrickIsFoundByThatBrick) {
  flipEveryByteOfBricks(format::Codec::kStored);
}

TEST(DamagedFile, EveryFlippedByteInALz4BrickIsFoundByThatBrick) {
  flipEveryByteOfBricks(format::Codec::kLz4);
}

TEST(DamagedFile, EveryFlippedByteInAZstdBrickIsFoundByThatBrick) {
  flipEveryByteOfBricks(format::Codec::kZstd);
}

TEST(DamagedFile, RandomFlipsAnywhere) {
  const TemporaryFolder folder;
  const std::string bad = folder.file("bad.isb");
  Random random(13);
  Bytes good;
  for (int round = 0; round < 3000; ++round) {
    if (round % 1000 == 0)
      good = readWholeFile(buildGoodFile(folder, VoxelType::kFloat32, kCodecs[round / 1000]));
    Bytes bytes = good;
    for (std::uint64_t flips = 1 + randomBelow(random, 4); flips > 0; --flips) {
      const std::uint64_t at = randomBelow(random, bytes.size());
      bytes[at] = static_cast<std::uint8_t>(randomBelow(random, 256));
    }
    writeBytes(bad, bytes);
    ASSERT_EQ(judge(bad).isGood(), bytes == good) << "round " << round;
  }
}

// A file full of noise behind a sound header is no better than a damaged one.
TEST(DamagedFile, ThingsThatAreNotPyramids) {
  const TemporaryFolder folder;
  const std::string bad = folder.file("bad.isb");
  EXPECT_THROW(Pyramid(folder.file("missing.isb")), Error);
  EXPECT_THROW(Pyramid(folder.path()), Error);
  for (const std::size_t bytes : {0, 1, 511, 512, 5000}) {
    writeBytes(bad, Bytes(bytes, 0x49));
    EXPECT_NE(judge(bad).open_error, "");
    writeBytes(bad, Bytes(bytes, 0));
    EXPECT_NE(judge(bad).open_error, "");
  }
  Bytes other = readWholeFile(buildTinyFile(folder));
  for (const std::uint32_t version : {1, 2, 6}) {
    putU32(other, 8, version);
    sealHeader(other);
    writeBytes(bad, other);
    EXPECT_NE(judge(bad).open_error.find("format version " + std::to_string(version)),
              std::string::npos);
  }
}

// What version 4 has room for is refused as that, and not as damaged.
TEST(DamagedFile, WhatALaterProgramMayWrite) {
  const TemporaryFolder folder;
  const std::string path = folder.file("later.isb");
  Bytes bytes = readWholeFile(buildTinyFile(folder));
  const auto openError = [&] {
    sealHeader(bytes);
    writeBytes(path, bytes);
    return judge(path).open_error;
  };
  putU32(bytes, 8, 4);
  EXPECT_NE(openError().find("impossible numbers"), std::string::npos);  // a scale of 0
  putU64(bytes, 432, std::bit_cast<std::uint64_t>(0.5));
  putU64(bytes, 440, std::bit_cast<std::uint64_t>(-1000.0));
  EXPECT_EQ(openError(), "");
  EXPECT_EQ(Pyramid(path).spec().values, (ValueTransform{0.5, -1000}));
  putU32(bytes, 24, 5);
  EXPECT_NE(openError().find("holds labels"), std::string::npos) << openError();
}

}  // namespace
}  // namespace isobrick::test
