// Header, tables and packed bytes set to numbers that do harm, with checksums that are right: an
// Error or a damaged brick, never a crash.

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <functional>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "isobrick/storage/checksum.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid.h"
#include "tests/support/every_brick.h"
#include "tests/support/file_edits.h"
#include "tests/support/noise_pyramid.h"
#include "tests/support/plain_bricks.h"
#include "tests/support/plain_reader.h"
#include "tests/support/pyramid_verdict.h"
#include "tests/support/random_numbers.h"
#include "tests/support/sealed_pyramid.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

// Prefixes with a file_bytes that fits: the tables are then outside the file.
TEST(HostileFile, EveryPrefixWithACorrectedHeaderIsRefused) {
  const TemporaryFolder folder;
  const Bytes good = readWholeFile(buildTinyFile(folder));
  const std::string bad = folder.file("bad.isb");
  for (std::size_t length = 512; length < good.size(); ++length) {
    Bytes bytes(good.begin(), good.begin() + static_cast<std::ptrdiff_t>(length));
    putU64(bytes, kFileBytesAt, length);
    sealHeader(bytes);
    writeBytes(bad, bytes);
    ASSERT_NE(judge(bad).open_error, "") << length << " bytes";
  }
}

// Packed bytes edited with checksums that fit: Blosc and what is checked before it are all that is
// left. Only the brick of these bytes may be worse for it.
TEST(HostileFile, SealedEditsOfPackedBytes) {
  const TemporaryFolder folder;
  const std::string bad = folder.file("bad.isb");
  Random random(15);
  for (const format::Codec codec : {format::Codec::kLz4, format::Codec::kZstd}) {
    const std::string path = buildGoodFile(folder, VoxelType::kUint16, codec);
    const Bytes good = readWholeFile(path);
    const PlainPyramid plain = readPlainPyramid(path);
    int refused = 0;
    for (int round = 0; round < 1000; ++round) {
      const std::size_t row = randomBelow(random, plain.bricks.size());
      const std::size_t kind = randomBelow(random, 3);
      const PlainPart& part = plain.bricks[row].parts[kind];
      if (part.codec != static_cast<std::uint32_t>(codec)) continue;
      Bytes bytes = good;
      for (std::uint64_t edits = 1 + randomBelow(random, 3); edits > 0; --edits) {
        // Half of them in the header and the table of blocks.
        const std::uint64_t reach = round % 2 == 0 ? 24 : part.stored_bytes;
        bytes[part.offset + randomBelow(random, reach)] = static_cast<std::uint8_t>(random());
      }
      putU64(bytes, plain.brick_table_offset + row * kBrickRowBytes + kind * 24 + 8,
             checksum64(bytes.data() + part.offset, part.stored_bytes));
      sealTables(bytes);
      writeBytes(bad, bytes);
      const Verdict verdict = judge(bad);
      ASSERT_EQ(verdict.open_error, "");
      if (verdict.damaged.empty()) continue;
      ASSERT_EQ(verdict.damaged, (std::vector<std::size_t>{row}));
      ++refused;
    }
    EXPECT_GT(refused, 100);
  }
}

constexpr std::uint64_t kNastyNumbers[] = {
    0, 1, 2, 3, 63, 64, 255, 256, 511, 4096, 1u << 20, (1u << 20) + 1,
    // Where 32 or 64 bits, with a sign or without, come to their end.
    0x7fffffff, 0x80000000, 0xffffffff, 0x100000000, 0x7fffffffffffffff, 0x8000000000000000,
    0xffffffffffffffc0, 0xffffffffffffffff,
    // As a double NaN, infinity, -infinity and the greatest; as two floats the greatest and NaN.
    0x7ff8000000000000, 0x7ff0000000000000, 0xfff0000000000000, 0x7fefffffffffffff,
    0x7f7fffff7f7fffff, 0x7fc000007fc00000};

// Every 4 and 8 bytes of the header set to nasty numbers, with a header checksum that fits. Some
// such files are honest pyramids of something else (another origin): they may open, but whatever
// opens can be read to its end.
TEST(HostileFile, NastyNumbersInASealedHeader) {
  const TemporaryFolder folder;
  const std::string path = buildGoodFile(folder);
  const Bytes good = readWholeFile(path);
  const std::string bad = folder.file("bad.isb");
  // Fields whose every other value contradicts the rest of the file: magic .. voxel_type,
  // level_count .. dims (a smaller tile or another kind_count changes the parts' sizes), and the
  // places of tables and histogram. A changed filter, spacing, origin, direction, value range,
  // epsilon or noise is another, sound pyramid, and so is one with an unknown kind.
  const auto mustFail = [](std::uint64_t at) {
    return at < 24 || (at >= 32 && at < 72) || (at >= 216 && at < 296);
  };
  for (std::uint64_t at = 0; at < kHeaderChecksumAt; at += 4)
    for (const std::uint64_t number : kNastyNumbers)
      for (const bool wide : {false, true}) {
        if (wide && (at % 8 != 0)) continue;
        Bytes bytes = good;
        if (wide)
          putU64(bytes, at, number);
        else
          putU32(bytes, at, static_cast<std::uint32_t>(number));
        if (bytes == good) continue;
        sealHeader(bytes);
        writeBytes(bad, bytes);
        const Verdict verdict = judge(bad);
        if (mustFail(at) && at + (wide ? 8u : 4u) <= 296) {
          ASSERT_FALSE(verdict.isGood()) << "offset " << at << " set to " << number;
        }
      }
}

TEST(HostileFile, NumbersThatAreNotFiniteInASealedHeader) {
  const TemporaryFolder folder;
  const Bytes good = readWholeFile(buildGoodFile(folder));
  const std::string bad = folder.file("bad.isb");
  for (std::uint64_t at = 72; at < 216; at += 8)
    for (const double number :
         {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(),
          -std::numeric_limits<double>::infinity()}) {
      Bytes bytes = good;
      putU64(bytes, at, std::bit_cast<std::uint64_t>(number));
      sealHeader(bytes);
      writeBytes(bad, bytes);
      ASSERT_NE(judge(bad).open_error, "") << "offset " << at << " set to " << number;
    }
}

// A range that no voxels of the type have would ask for a histogram of any size.
TEST(HostileFile, ValuesThatNoVoxelHasAreRefused) {
  constexpr double kTooSmall = 1e-60, kBeyondFloat = 1e300, kHalf = 50.5, kNotSingle = 0.1;
  for (std::uint32_t type = 0; type < kVoxelTypeCount; ++type) {
    const TemporaryFolder folder;
    const Bytes good = readWholeFile(buildGoodFile(folder, static_cast<VoxelType>(type)));
    const std::string bad = folder.file("bad.isb");
    const auto openError = [&](const std::function<void(format::Header&)>& edit) {
      PyramidDraft draft(good);
      edit(draft.header);
      writeBytes(bad, draft.seal());
      return judge(bad).open_error;
    };
    EXPECT_EQ(openError([](format::Header&) {}), "");
    const bool is_float = static_cast<VoxelType>(type) == VoxelType::kFloat32;
    const std::vector<double> wrong =
        is_float ? std::vector{kTooSmall, kBeyondFloat, -kBeyondFloat, kNotSingle}
                 : std::vector{kTooSmall,
                               kBeyondFloat,
                               -kBeyondFloat,
                               kHalf,
                               65536.0,
                               -32769.0,
                               type % 2 == 0 ? -1.0
                               : type == 1   ? 128.0
                                             : 32768.0};
    for (const double value : wrong) {
      const auto refused = [&](const std::string& error) {
        EXPECT_NE(error.find("impossible numbers"), std::string::npos)
            << voxelTypeName(static_cast<VoxelType>(type)) << " " << value << ": " << error;
      };
      refused(openError([&](format::Header& h) { h.value_min = h.value_max = value; }));
      if (value < 77) refused(openError([&](format::Header& h) { h.value_min = value; }));
      if (value > 77) refused(openError([&](format::Header& h) { h.value_max = value; }));
    }
    for (const double noise : {-1.0, 1e300, std::nan("")}) {
      const std::string error = openError([&](format::Header& h) { h.noise = noise; });
      EXPECT_NE(error.find("impossible numbers"), std::string::npos) << noise << ": " << error;
    }
    EXPECT_NE(openError([](format::Header& h) { h.noise = 2 * (h.value_max - h.value_min) + 1; }),
              "");
  }
}

TEST(HostileFile, DimensionsThatPromiseMoreThanTheFileHolds) {
  const TemporaryFolder folder;
  const Bytes good = readWholeFile(buildTinyFile(folder));
  const std::string bad = folder.file("bad.isb");
  for (const std::uint64_t n : {std::uint64_t{4}, std::uint64_t{1000}, std::uint64_t{1} << 20})
    for (std::uint64_t axes = 1; axes < 8; ++axes) {
      Bytes bytes = good;
      std::uint64_t most = 0;
      for (std::uint64_t axis = 0; axis < 3; ++axis) {
        if ((axes >> axis & 1) != 0) putU64(bytes, 48 + 8 * axis, n);
        most = std::max(most, getU64(bytes, 48 + 8 * axis) - 1);
      }
      std::uint32_t levels = 1;
      while ((std::uint64_t{1} << (levels - 1)) < most) ++levels;
      putU32(bytes, 32, levels);
      sealHeader(bytes);
      writeBytes(bad, bytes);
      ASSERT_NE(judge(bad).open_error, "") << n << " voxels, axes " << axes;
    }
}

// Every field of both tables, with all checksums recomputed: the bricks' own checksums and the
// checks of values are what is left.
TEST(HostileFile, NastyNumbersInSealedTables) {
  const TemporaryFolder folder;
  for (const auto& [type, codec] : {std::pair{VoxelType::kUint8, format::Codec::kStored},
                                    {VoxelType::kFloat32, format::Codec::kZstd}}) {
    const std::string path = buildGoodFile(folder, type, codec);
    const Bytes good = readWholeFile(path);
    const PlainPyramid plain = readPlainPyramid(path);
    const std::string bad = folder.file("bad.isb");
    const auto attack = [&](std::uint64_t first, std::uint64_t count, std::uint64_t stride) {
      for (std::uint64_t at = first; at < first + count; at += stride)
        for (const std::uint64_t number : kNastyNumbers) {
          Bytes bytes = good;
          putU32(bytes, at, static_cast<std::uint32_t>(number));
          if (at + 8 <= good.size() && number > 0xffffffffu) putU64(bytes, at, number);
          if (bytes == good) continue;
          sealTables(bytes);
          writeBytes(bad, bytes);
          judge(bad);  // any answer will do; the sanitizers see the rest
        }
    };
    attack(plain.level_table_offset, plain.levels.size() * kLevelRowBytes, 4);
    // Rows with all kinds of parts: the first, a constant one, the last.
    for (const std::size_t row : {std::size_t{0}, std::size_t{4}, plain.bricks.size() - 1})
      attack(plain.brick_table_offset + row * kBrickRowBytes, kBrickRowBytes, 4);
  }
}

TEST(HostileFile, SealedBrickRowsThatContradictThemselvesAreFound) {
  const TemporaryFolder folder;
  for (const VoxelType type : {VoxelType::kUint8, VoxelType::kInt16, VoxelType::kFloat32}) {
    const std::string path = buildGoodFile(folder, type, format::Codec::kStored);
    const Bytes good = readWholeFile(path);
    const PlainPyramid plain = readPlainPyramid(path);
    const std::string bad = folder.file("bad.isb");
    std::size_t stored = plain.bricks.size(), constant = plain.bricks.size();
    for (std::size_t row = plain.bricks.size(); row-- > 0;)
      (plain.bricks[row].parts[0].codec == 0 ? stored : constant) = row;
    ASSERT_LT(stored, plain.bricks.size());
    ASSERT_LT(constant, plain.bricks.size());
    struct Edit {
      const char* what;
      std::size_t row;
      std::uint64_t offset;
      std::uint64_t value;
      int bytes;
    };
    const auto bits = [](float value) {
      return std::uint64_t{std::bit_cast<std::uint32_t>(value)};
    };
    const float infinity = std::numeric_limits<float>::infinity();
    const Edit edits[] = {
        {"samples beyond the end", stored, 0, good.size() / 64 * 64, 8},
        {"samples far beyond the end", stored, 0, ~std::uint64_t{63}, 8},
        {"samples in the header", stored, 0, 0, 8},
        {"samples not aligned", stored, 0, plain.bricks[stored].parts[0].offset + 1, 8},
        {"another checksum", stored, 8, 1, 8},
        {"more bytes", stored, 16, plain.bricks[stored].parts[0].stored_bytes + 1, 4},
        {"fewer bytes", stored, 16, 1, 4},
        {"stored without bytes", constant, 20, 0, 4},
        {"constant with bytes", stored, 20, 1, 4},
        {"absent samples", constant, 20, 2, 4},
        {"packed without bytes", constant, 20, 3, 4},
        {"packed without a Blosc buffer", stored, 20, 4, 4},
        {"unknown codec", constant, 20, 5, 4},
        {"unknown codec of stored bytes", stored, 20, 0xffffffff, 4},
        {"absent ranges", constant, 44, 2, 4},
        {"range NaN", constant, 72, bits(std::nanf("")), 4},
        {"range reversed", stored, 72, bits(30000), 4},
        {"range too narrow", stored, 76, bits(-100), 4},
        {"constant above its range", constant, 80, bits(78), 4},
        {"constant that no voxel holds", constant, 80, bits(1e30f), 4},
        {"constant -1e30", constant, 80, bits(-1e30f), 4},
        {"constant infinite", constant, 80, bits(infinity), 4},
        {"constant NaN", constant, 80, bits(std::nanf("")), 4},
    };
    for (const Edit& edit : edits) {
      Bytes bytes = good;
      const std::uint64_t at = plain.brick_table_offset + edit.row * kBrickRowBytes + edit.offset;
      if (edit.bytes == 8)
        putU64(bytes, at, edit.value);
      else
        putU32(bytes, at, static_cast<std::uint32_t>(edit.value));
      sealTables(bytes);
      writeBytes(bad, bytes);
      const Verdict verdict = judge(bad);
      EXPECT_FALSE(verdict.isGood()) << voxelTypeName(type) << ": " << edit.what;
      const PlainBrick& brick = plain.bricks[edit.row];
      if (!verdict.open_error.empty())
        EXPECT_NE(verdict.open_error.find(brickName(brick.level, indexOf(brick))),
                  std::string::npos)
            << edit.what << ": " << verdict.open_error;
      else
        EXPECT_EQ(verdict.damaged, (std::vector<std::size_t>{edit.row})) << edit.what;
    }
  }
}

TEST(HostileFile, SealedRowsOfPackedPartsThatContradictThemselvesAreFound) {
  const TemporaryFolder folder;
  const std::string bad = folder.file("bad.isb");
  for (const format::Codec codec : {format::Codec::kLz4, format::Codec::kZstd}) {
    const std::string path = buildGoodFile(folder, VoxelType::kUint16, codec);
    const Bytes good = readWholeFile(path);
    const PlainPyramid plain = readPlainPyramid(path);
    std::size_t row = 0;
    while (plain.bricks[row].parts[0].codec != static_cast<std::uint32_t>(codec)) ++row;
    const auto elements = static_cast<std::uint32_t>(2 * plain.bricks[row].samples.size());
    const std::uint32_t stored = plain.bricks[row].parts[0].stored_bytes;
    const std::uint32_t other = codec == format::Codec::kLz4 ? 4 : 3;
    const std::pair<std::uint64_t, std::uint32_t> edits[] = {{16, 0},
                                                             {16, elements},
                                                             {16, elements + 1},
                                                             {16, 0xffffffff},
                                                             {16, stored - 1},
                                                             {16, stored + 1},
                                                             {20, 0},
                                                             {20, 1},
                                                             {20, 2},
                                                             {20, other},
                                                             {20, 5},
                                                             {0, 64 * 1000000},
                                                             {0, 1}};
    for (const auto& [offset, value] : edits) {
      Bytes bytes = good;
      putU32(bytes, plain.brick_table_offset + row * kBrickRowBytes + offset, value);
      sealTables(bytes);
      writeBytes(bad, bytes);
      const Verdict verdict = judge(bad);
      EXPECT_FALSE(verdict.isGood()) << offset << " = " << value;
      if (verdict.open_error.empty()) {
        EXPECT_EQ(verdict.damaged, (std::vector<std::size_t>{row})) << offset << " = " << value;
      }
    }
    // Constant ranges of samples that are not constant.
    Bytes bytes = good;
    const std::uint64_t ranges = plain.brick_table_offset + row * kBrickRowBytes + 24;
    std::memset(bytes.data() + ranges, 0, 24);
    putU32(bytes, ranges + 20, 1);
    sealTables(bytes);
    writeBytes(bad, bytes);
    EXPECT_EQ(judge(bad).damaged, (std::vector<std::size_t>{row}));
    const PlainBrick& brick = plain.bricks[row];
    try {
      Pyramid(bad).samples(brick.level, indexOf(brick));
      ADD_FAILURE() << "no error";
    } catch (const Error& error) {
      EXPECT_NE(std::string(error.what()).find("impossible entry"), std::string::npos);
    }
  }
}

// Directions and spacings that overflow are no placement.
TEST(HostileFile, PlacementsWithoutUsablePositionsAreRefused) {
  const TemporaryFolder folder;
  const Bytes good = readWholeFile(buildTinyFile(folder));
  const std::string bad = folder.file("bad.isb");
  for (const auto& [at, number] :
       {std::pair<std::uint64_t, double>{72, 1e300}, {72, 1e-300}, {96, -1e300}, {120, 1e300}}) {
    Bytes bytes = good;
    putU64(bytes, at, std::bit_cast<std::uint64_t>(number));
    sealHeader(bytes);
    writeBytes(bad, bytes);
    EXPECT_NE(judge(bad).open_error.find("positions"), std::string::npos) << number;
  }
}

}  // namespace
}  // namespace isobrick::test
