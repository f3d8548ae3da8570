// Damaged, hostile and truncated files, full disks, and the pager's budget: everything ends in an
// Error that names what is wrong, never in a crash, a wrong value or a file that should not exist.

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <csignal>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <numeric>
#include <random>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/storage/brick_encoder.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid.h"
#include "isobrick/storage/pyramid_parts.h"
#include "isobrick/storage/pyramid_verify.h"
#include "isobrick/storage/pyramid_writer.h"
#include "tests/support/array_source.h"
#include "tests/support/build_message.h"
#include "tests/support/child_process.h"
#include "tests/support/plain_reader.h"
#include "tests/support/random_numbers.h"
#include "tests/support/requirement.h"
#include "tests/support/sealed_pyramid.h"

namespace isobrick::test {
namespace {

// On a disk, unlike tests/temporary_folder.h: what the kernel keeps resident of a mapped file in
// memory says nothing about paging.
class DiskFolder {
 public:
  DiskFolder() {
    std::string name =
        (std::filesystem::temp_directory_path() / "isobrick-hostile-XXXXXX").string();
    if (mkdtemp(name.data()) == nullptr) throw std::runtime_error("no temporary folder");
    path_ = name;
  }
  ~DiskFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  std::string path() const { return path_.string(); }
  std::string file(const std::string& name) const { return (path_ / name).string(); }
  std::vector<std::string> names() const {
    std::vector<std::string> result;
    for (const auto& entry : std::filesystem::directory_iterator(path_))
      result.push_back(entry.path().filename().string());
    std::sort(result.begin(), result.end());
    return result;
  }

 private:
  std::filesystem::path path_;
};

// Noise with constant regions, so that all codecs occur.
class NoiseSource : public CheckedSource {
 public:
  NoiseSource(const Index3& dims, VoxelType type) : CheckedSource(dims, type) {
    editInfo().source = "noise";
  }
  std::int64_t fail_at_row_ = -1;
  std::int64_t constant_from_x_ = std::numeric_limits<std::int64_t>::max();

 private:
  void fillRows(std::int64_t first, std::int64_t count, void* out) override {
    if (first <= fail_at_row_ && fail_at_row_ < first + count) throw Error("the input ends");
    const Index3 dims = info().voxels;
    visitVoxelType(info().voxel_type, [&](auto tag) {
      using T = typename decltype(tag)::Type;
      T* to = static_cast<T*>(out);
      for (std::int64_t i = 0; i < count * dims.x; ++i)
        to[i] = i % dims.x >= constant_from_x_ ? T{77} : static_cast<T>(random_() % 100);
    });
  }

  Random random_{11};
};

constexpr format::Codec kCodecs[] = {format::Codec::kStored, format::Codec::kLz4,
                                     format::Codec::kZstd};

BuildOptions smallBricks(format::Codec codec = format::Codec::kLz4) {
  BuildOptions options;
  options.brick_cells = 4;
  options.tile_cells = 2;
  options.codec = codec;
  return options;
}

// Several levels, several bricks in each, constant parts and, but for kStored, packed ones.
std::string buildGoodFile(const DiskFolder& folder, VoxelType type = VoxelType::kUint16,
                          format::Codec codec = format::Codec::kLz4) {
  NoiseSource source(Index3(19, 9, 11), type);
  source.constant_from_x_ = 8;
  const std::string path = folder.file("good.isb");
  buildPyramid(source, path, smallBricks(codec));
  return path;
}

std::string buildTinyFile(const DiskFolder& folder) {
  NoiseSource source(Index3(3, 2, 2), VoxelType::kUint8);
  const std::string path = folder.file("tiny.isb");
  buildPyramid(source, path, smallBricks());
  return path;
}

// In place: ext4 flushes a file that was truncated and written anew, which costs a millisecond.
void writeBytes(const std::string& path, const Bytes& bytes) {
  const int fd = open(path.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
  const bool written =
      fd >= 0 && pwrite(fd, bytes.data(), bytes.size(), 0) == static_cast<ssize_t>(bytes.size()) &&
      ftruncate(fd, static_cast<off_t>(bytes.size())) == 0;
  if (fd >= 0) close(fd);
  if (!written) throw std::runtime_error("cannot write " + path);
}

void putU32(Bytes& bytes, std::uint64_t at, std::uint32_t value) {
  std::memcpy(bytes.data() + at, &value, sizeof value);
}
void putU64(Bytes& bytes, std::uint64_t at, std::uint64_t value) {
  std::memcpy(bytes.data() + at, &value, sizeof value);
}
std::uint64_t getU64(const Bytes& bytes, std::uint64_t at) {
  std::uint64_t value;
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return value;
}

// Offsets of docs/FORMAT.md section 2.
constexpr std::uint64_t kFileBytesAt = 16, kLevelTableAt = 216, kBrickTableAt = 232,
                        kBrickCountAt = 240, kHeaderChecksumAt = 504;
constexpr std::uint64_t kLevelRowBytes = 56, kBrickRowBytes = 96;

// What an attacker does after editing header or tables: the hashes are no secret.
void sealHeader(Bytes& bytes) {
  putU64(bytes, kHeaderChecksumAt, XXH3_64bits(bytes.data(), kHeaderChecksumAt));
}
void sealTables(Bytes& bytes) {
  std::uint32_t levels;
  std::memcpy(&levels, bytes.data() + 32, sizeof levels);
  putU64(bytes, kLevelTableAt + 8,
         XXH3_64bits(bytes.data() + getU64(bytes, kLevelTableAt), levels * kLevelRowBytes));
  const std::uint64_t rows = getU64(bytes, kBrickCountAt);
  for (std::uint64_t row = 0; row < rows; ++row) {
    const std::uint64_t at = getU64(bytes, kBrickTableAt) + row * kBrickRowBytes;
    putU64(bytes, at + kBrickRowBytes - 8,
           XXH3_64bits_withSeed(bytes.data() + at, kBrickRowBytes - 8, row));
  }
  sealHeader(bytes);
}

std::string brickText(int level, const Index3& brick) {
  std::ostringstream text;
  text << "brick (" << brick.x << "," << brick.y << "," << brick.z << ") of level " << level;
  return text.str();
}

template <typename F>
void forAllBricks(const Pyramid& pyramid, F&& f) {
  for (int level = 0; level < pyramid.lattice().levels(); ++level) {
    const Index3 count = pyramid.layout().bricks(level);
    Index3 brick;
    for (brick.z = 0; brick.z < count.z; ++brick.z)
      for (brick.y = 0; brick.y < count.y; ++brick.y)
        for (brick.x = 0; brick.x < count.x; ++brick.x) f(level, brick);
  }
}

struct Verdict {
  std::string open_error;            // empty: the file opened
  std::vector<std::size_t> damaged;  // rows of the bricks that verifyBrick reports
  std::vector<std::string> rest;     // what verifyRest reports
};

// Opens the file and verifies every brick and the rest; the only ways to say no are Error,
// BrickDamage and a line of verifyRest.
Verdict judge(const std::string& path) {
  Verdict verdict;
  try {
    const Pyramid pyramid(path);
    forAllBricks(pyramid, [&](int level, const Index3& brick) {
      const auto damage = verifyBrick(pyramid, level, brick);
      if (!damage) return;
      verdict.damaged.push_back(pyramid.parts().brickRow(level, brick));
      EXPECT_EQ(damage->level, level);
      EXPECT_EQ(damage->brick, brick);
      EXPECT_FALSE(damage->what.empty());
      // Who prints it says which brick and which file.
      EXPECT_EQ(damage->what.find(brickText(level, brick)), std::string::npos) << damage->what;
      EXPECT_EQ(damage->what.find(path), std::string::npos) << damage->what;
    });
    verdict.rest = verifyRest(pyramid);
  } catch (const Error& error) {
    verdict.open_error = error.what();
    // One line that names the file.
    EXPECT_NE(verdict.open_error.find(path), std::string::npos) << verdict.open_error;
    EXPECT_EQ(verdict.open_error.find('\n'), std::string::npos) << verdict.open_error;
  }
  return verdict;
}

bool isGood(const Verdict& verdict) {
  return verdict.open_error.empty() && verdict.damaged.empty() && verdict.rest.empty();
}

TEST(HostileFile, TheGoodFileIsGood) {
  const DiskFolder folder;
  for (const format::Codec codec : kCodecs)
    for (int type = 0; type < 5; ++type) {
      const std::string path = buildGoodFile(folder, static_cast<VoxelType>(type), codec);
      EXPECT_TRUE(isGood(judge(path)));
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

TEST(HostileFile, EveryFlippedBitOfATinyFileIsFound) {
  const DiskFolder folder;
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
      ASSERT_FALSE(isGood(verdict)) << "byte " << at << " bit " << bit;
      // Padding has no meaning, so the file can be used; everything else is under a checksum.
      if (covered[at]) continue;
      ASSERT_TRUE(verdict.open_error.empty() && verdict.damaged.empty());
      ASSERT_NE(verdict.rest.front().find("offset " + std::to_string(at)), std::string::npos)
          << verdict.rest.front();
    }
}

TEST(HostileFile, EveryPrefixOfATinyFileIsRefused) {
  const DiskFolder folder;
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

// The same prefixes by somebody who also corrects file_bytes: the tables are then outside the file.
TEST(HostileFile, EveryPrefixWithACorrectedHeaderIsRefused) {
  const DiskFolder folder;
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

TEST(HostileFile, TruncatedFilesAreRefused) {
  const DiskFolder folder;
  const Bytes good = readWholeFile(buildGoodFile(folder));
  const std::string bad = folder.file("bad.isb");
  for (std::size_t length = 0; length < good.size(); length += 1 + length / 40) {
    writeBytes(bad, Bytes(good.begin(), good.begin() + static_cast<std::ptrdiff_t>(length)));
    ASSERT_NE(judge(bad).open_error, "") << length << " bytes";
  }
}

TEST(HostileFile, EveryFlippedByteOfHeaderAndTablesIsFound) {
  const DiskFolder folder;
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
  constexpr std::uint64_t kHistogramAt = 272;
  mustNotOpen(0, 512);
  mustNotOpen(plain.level_table_offset, plain.levels.size() * kLevelRowBytes);
  mustNotOpen(plain.provenance_offset, plain.provenance.size());
  // A row is looked at when its brick is asked for, and the histogram when it is.
  for (std::uint64_t i = 0; i < plain.bricks.size() * kBrickRowBytes; ++i)
    ASSERT_EQ(flipped(plain.brick_table_offset + i).damaged,
              (std::vector<std::size_t>{i / kBrickRowBytes}))
        << "byte " << i << " of the table";
  const std::uint64_t histogram = getU64(good, kHistogramAt);
  for (std::uint64_t i = 0; i < getU64(good, kHistogramAt + 16) % (std::uint64_t{1} << 32); ++i) {
    const Verdict verdict = flipped(histogram + i);
    ASSERT_EQ(verdict.rest.size(), 1u) << "byte " << i << " of the histogram";
    ASSERT_NE(verdict.rest.front().find("damaged histogram"), std::string::npos);
  }
  constexpr std::uint64_t kGradientsAt = 368;
  const std::uint64_t gradients = getU64(good, kGradientsAt);
  ASSERT_NE(gradients, 0u);
  for (std::uint64_t i = 0; i < getU64(good, kGradientsAt + 16) % (std::uint64_t{1} << 32); ++i) {
    const Verdict verdict = flipped(gradients + i);
    ASSERT_EQ(verdict.rest.size(), 1u) << "byte " << i << " of the gradients";
    ASSERT_NE(verdict.rest.front().find("damaged gradient"), std::string::npos);
  }
}

// Every byte of every part: verifyBrick of the brick that owns it finds it, no other brick does,
// and whoever asks for the samples gets an Error that names brick and level.
void flipEveryByteOfBricks(format::Codec codec) {
  const DiskFolder folder;
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
        const Index3 index{brick.index[0], brick.index[1], brick.index[2]};
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
        ASSERT_NE(message.find(brickText(brick.level, index)), std::string::npos)
            << "'" << message << "' lacks " << brickText(brick.level, index);
        ASSERT_NE(message.find(bad), std::string::npos) << message;
      }
    }
  EXPECT_GT(flips, 500u);
}

TEST(HostileFile, EveryFlippedByteInAStoredBrickIsFoundByThatBrick) {
  flipEveryByteOfBricks(format::Codec::kStored);
}
TEST(HostileFile, EveryFlippedByteInALz4BrickIsFoundByThatBrick) {
  flipEveryByteOfBricks(format::Codec::kLz4);
}
TEST(HostileFile, EveryFlippedByteInAZstdBrickIsFoundByThatBrick) {
  flipEveryByteOfBricks(format::Codec::kZstd);
}

// Packed bytes edited by somebody who also makes the checksums fit: Blosc and what is checked
// before it are all that is left. Only the brick of these bytes may be worse for it.
TEST(HostileFile, SealedEditsOfPackedBytes) {
  const DiskFolder folder;
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
             XXH3_64bits(bytes.data() + part.offset, part.stored_bytes));
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

TEST(HostileFile, RandomFlipsAnywhere) {
  const DiskFolder folder;
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
    ASSERT_EQ(isGood(judge(bad)), bytes == good) << "round " << round;
  }
}

constexpr std::uint64_t kNastyNumbers[] = {0,
                                           1,
                                           2,
                                           3,
                                           63,
                                           64,
                                           255,
                                           256,
                                           511,
                                           4096,
                                           1u << 20,
                                           (1u << 20) + 1,
                                           0x7fffffffull,
                                           0x80000000ull,
                                           0xffffffffull,
                                           0x100000000ull,
                                           0x7fffffffffffffffull,
                                           0x8000000000000000ull,
                                           0xffffffffffffffc0ull,
                                           0xffffffffffffffffull,
                                           0x7ff8000000000000ull,   // NaN
                                           0x7ff0000000000000ull,   // infinity
                                           0xfff0000000000000ull,   // -infinity
                                           0x7fefffffffffffffull,   // the greatest double
                                           0x7f7fffff7f7fffffull,   // two of the greatest floats
                                           0x7fc000007fc00000ull};  // two float NaNs

// Every 4 and 8 bytes of the header set to nasty numbers, with a header checksum that fits. Some
// such files are honest pyramids of something else (another origin): they may open, but whatever
// opens can be read to its end.
TEST(HostileFile, NastyNumbersInASealedHeader) {
  const DiskFolder folder;
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
          ASSERT_FALSE(isGood(verdict)) << "offset " << at << " set to " << number;
        }
      }
}

TEST(HostileFile, NumbersThatAreNotFiniteInASealedHeader) {
  const DiskFolder folder;
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
    const DiskFolder folder;
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
  const DiskFolder folder;
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
  const DiskFolder folder;
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
  const DiskFolder folder;
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
        {"absent curvature", constant, 68, 2, 4},
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
      EXPECT_FALSE(isGood(verdict)) << voxelTypeName(type) << ": " << edit.what;
      const PlainBrick& brick = plain.bricks[edit.row];
      if (!verdict.open_error.empty())
        EXPECT_NE(verdict.open_error.find(
                      brickText(brick.level, {brick.index[0], brick.index[1], brick.index[2]})),
                  std::string::npos)
            << edit.what << ": " << verdict.open_error;
      else
        EXPECT_EQ(verdict.damaged, (std::vector<std::size_t>{edit.row})) << edit.what;
    }
  }
}

TEST(HostileFile, SealedRowsOfPackedPartsThatContradictThemselvesAreFound) {
  const DiskFolder folder;
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
      EXPECT_FALSE(isGood(verdict)) << offset << " = " << value;
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
      Pyramid(bad).samples(brick.level, {brick.index[0], brick.index[1], brick.index[2]});
      ADD_FAILURE() << "no error";
    } catch (const Error& error) {
      EXPECT_NE(std::string(error.what()).find("impossible entry"), std::string::npos);
    }
  }
}

// Changes elements of every brick that `edit` takes, seals the file and returns what verify says.
using EditElements =
    std::function<bool(const PyramidDraft&, const PyramidDraft::Brick&, PyramidDraft::Elements&)>;
Verdict judgeEdited(const DiskFolder& folder, const Bytes& good, const EditElements& edit) {
  PyramidDraft draft(good);
  for (PyramidDraft::Brick& brick : draft.bricks) {
    PyramidDraft::Elements elements = draft.elementsOf(brick);
    if (edit(draft, brick, elements)) draft.setElements(brick, elements, format::Codec::kStored);
  }
  const std::string bad = folder.file("bad.isb");
  writeBytes(bad, draft.seal());
  return judge(bad);
}

template <typename T>
T elementAt(const std::vector<std::byte>& elements, std::size_t i) {
  T value;
  std::memcpy(&value, elements.data() + i * sizeof value, sizeof value);
  return value;
}
template <typename T>
void setElement(std::vector<std::byte>& elements, std::size_t i, T value) {
  std::memcpy(elements.data() + i * sizeof value, &value, sizeof value);
}

TEST(HostileFile, ADraftThatWasNotChangedIsGood) {
  const DiskFolder folder;
  for (const format::Codec codec : kCodecs) {
    const Bytes good = readWholeFile(buildGoodFile(folder, VoxelType::kInt16, codec));
    EXPECT_TRUE(
        isGood(judgeEdited(folder, good, [](const auto&, const auto&, auto&) { return true; })));
  }
}

// Tiles of every brick in turn, one step too narrow or too wide at either end.
TEST(HostileFile, TileRangesThatAreNotThoseOfTheirSamplesAreFound) {
  const DiskFolder folder;
  const Bytes good =
      readWholeFile(buildGoodFile(folder, VoxelType::kUint16, format::Codec::kStored));
  Random random(21);
  const std::size_t rows = PyramidDraft(good).bricks.size();
  std::size_t narrow = 0, wide = 0, named = 0;
  for (std::size_t row = 0; row < rows; ++row)
    for (int round = 0; round < 8; ++round) {
      bool is_edited = false;
      const Verdict verdict =
          judgeEdited(folder, good,
                      [&](const PyramidDraft& draft, const PyramidDraft::Brick& brick,
                          PyramidDraft::Elements& elements) {
                        if (&brick != &draft.bricks[row]) return false;
                        const std::size_t end = randomBelow(random, elements[1].size() / 2);
                        const auto value = elementAt<std::uint16_t>(elements[1], end);
                        const bool is_low = end % 2 == 0;
                        const auto other = elementAt<std::uint16_t>(elements[1], end ^ 1);
                        const bool narrower = round % 2 == 0;
                        const int step = narrower == is_low ? 1 : -1;
                        const int changed = value + step;
                        if (narrower && value == other) return false;
                        if (static_cast<float>(changed) < brick.row.range_min ||
                            static_cast<float>(changed) > brick.row.range_max)
                          return false;
                        setElement(elements[1], end, static_cast<std::uint16_t>(changed));
                        is_edited = true;
                        ++(narrower ? narrow : wide);
                        return true;
                      });
      if (!is_edited) continue;
      ASSERT_EQ(verdict.open_error, "");
      ASSERT_FALSE(isGood(verdict)) << "row " << row << " round " << round;
      named += verdict.damaged == std::vector<std::size_t>{row};
    }
  EXPECT_GT(narrow, 20u);
  EXPECT_GT(wide, 20u);
  // Where only a coarser sample is left outside, it is that sample's brick that is named.
  EXPECT_GT(10 * named, 9 * (narrow + wide));
}

TEST(HostileFile, SamplesThatAreNotFiniteAreFound) {
  const DiskFolder folder;
  const Bytes good =
      readWholeFile(buildGoodFile(folder, VoxelType::kFloat32, format::Codec::kStored));
  Random random(22);
  using Limits = std::numeric_limits<float>;
  for (const float value : {Limits::quiet_NaN(), Limits::infinity(), -Limits::infinity()})
    for (int round = 0; round < 10; ++round) {
      const std::size_t row = randomBelow(random, 3);  // aprons too
      const Verdict verdict =
          judgeEdited(folder, good,
                      [&](const PyramidDraft& draft, const PyramidDraft::Brick& brick,
                          PyramidDraft::Elements& elements) {
                        if (&brick != &draft.bricks[row]) return false;
                        setElement(elements[0], randomBelow(random, elements[0].size() / 4), value);
                        return true;
                      });
      ASSERT_EQ(verdict.damaged, (std::vector<std::size_t>{row})) << value;
    }
}

TEST(HostileFile, ReservedFieldsAndValueRangesThatLieAreFound) {
  const DiskFolder folder;
  const Bytes good = readWholeFile(buildGoodFile(folder));
  const std::string bad = folder.file("bad.isb");
  const auto judgeDraft = [&](const std::function<void(PyramidDraft&)>& edit) {
    PyramidDraft draft(good);
    edit(draft);
    writeBytes(bad, draft.seal());
    return judge(bad);
  };
  EXPECT_TRUE(isGood(judgeDraft([](PyramidDraft&) {})));
  EXPECT_EQ(judgeDraft([](PyramidDraft& d) { d.header.reserved[41] = 1; }).rest.size(), 1u);
  // Another range is not that of the voxels, and the histogram is of another size.
  EXPECT_EQ(judgeDraft([](PyramidDraft& d) { d.header.value_max += 1; }).rest.size(), 2u);
  EXPECT_EQ(judgeDraft([](PyramidDraft& d) { d.header.kinds[7] = 1; }).rest.size(), 1u);
  EXPECT_EQ(judgeDraft([](PyramidDraft& d) { d.header.reserved_between[3] = 1; }).rest.size(), 1u);
  EXPECT_EQ(judgeDraft([](PyramidDraft& d) { d.header.error_bins[5] = 1; }).rest.size(), 1u);
  EXPECT_EQ(judgeDraft([](PyramidDraft& d) { d.bricks[2].row.unused = 1; }).damaged,
            (std::vector<std::size_t>{2}));
  EXPECT_EQ(judgeDraft([](PyramidDraft& d) { d.bricks[0].row.range_max += 1; }).damaged,
            (std::vector<std::size_t>{0}));
}

// What a later version may add: parts of a kind that nobody knows yet.
TEST(HostileFile, PartsOfUnknownKindsArePassedOver) {
  const DiskFolder folder;
  const std::string path = buildGoodFile(folder);
  PyramidDraft draft(readWholeFile(path));
  ASSERT_EQ(draft.header.kind_count, 3u);
  draft.header.kinds[draft.header.kind_count++] = 77;
  draft.header.kinds[draft.header.kind_count++] = 0xffffffff;
  const std::string later = folder.file("later.isb");
  writeBytes(later, draft.seal());
  EXPECT_TRUE(isGood(judge(later)));
  const Pyramid pyramid(path), newer(later);
  forAllBricks(pyramid, [&](int level, const Index3& brick) {
    const BrickSamples a = pyramid.samples(level, brick), b = newer.samples(level, brick);
    ASSERT_EQ(
        std::memcmp(a.part.data(), b.part.data(),
                    partBytes(pyramid.spec(), pyramid.layout(), PartKind::kSamples, level, brick)),
        0);
    EXPECT_EQ(pyramid.brickRange(level, brick), newer.brickRange(level, brick));
  });
  // Kinds are listed once, in ascending order, samples and ranges first.
  for (const auto& [at, kind] : {std::pair<std::size_t, std::uint32_t>{0, 1}, {1, 5}, {3, 2}}) {
    PyramidDraft wrong(draft);
    wrong.header.kinds[at] = kind;
    writeBytes(later, wrong.seal());
    EXPECT_NE(judge(later).open_error.find("impossible numbers"), std::string::npos) << at;
  }
}

// Directions and spacings that overflow are no placement.
TEST(HostileFile, PlacementsWithoutUsablePositionsAreRefused) {
  const DiskFolder folder;
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

// ---- files with holes: any size, for nothing ----

// A file of `bytes` bytes, all zero but for the header and the level table of a volume of n^3
// voxels in bricks of four cells.
void writeHollowFile(const std::string& path, std::int64_t n, std::uint64_t bytes) {
  PyramidSpec spec;
  spec.voxels = Index3(n);
  spec.brick_cells = 4;
  spec.tile_cells = 2;
  const BrickLayout layout = spec.layout();
  std::vector<format::LevelRow> levels;
  std::uint64_t rows = 0;
  for (int level = 0; level < layout.lattice().levels(); ++level) {
    format::LevelRow row{};
    for (int axis = 0; axis < 3; ++axis) {
      row.samples[axis] = static_cast<std::uint64_t>(layout.lattice().samples(level)[axis]);
      row.bricks[axis] = static_cast<std::uint64_t>(layout.bricks(level)[axis]);
    }
    row.first_brick = rows;
    rows += static_cast<std::uint64_t>(elementCount(layout.bricks(level)));
    levels.push_back(row);
  }
  format::Header header{};
  std::memcpy(header.magic, format::kMagic, sizeof header.magic);
  header.version = format::kVersion;
  header.header_bytes = sizeof header;
  header.file_bytes = bytes;
  header.level_count = static_cast<std::uint32_t>(levels.size());
  header.brick_cells = 4;
  header.tile_cells = 2;
  for (int axis = 0; axis < 3; ++axis) {
    header.dims[axis] = static_cast<std::uint64_t>(n);
    header.spacing[axis] = 1;
    header.direction[4 * axis] = 1;
  }
  header.level_table_offset = sizeof header;
  const std::uint64_t level_bytes = levels.size() * sizeof(format::LevelRow);
  header.level_table_checksum = XXH3_64bits(levels.data(), level_bytes);
  header.brick_table_offset = 8192;
  header.brick_count = rows;
  header.kind_count = 2;
  header.kinds[1] = 1;
  header.provenance_checksum = XXH3_64bits(nullptr, 0);
  ASSERT_LE(8192 + rows * format::rowBytes(header.kind_count), bytes);
  Bytes start(sizeof header + level_bytes);
  std::memcpy(start.data() + sizeof header, levels.data(), level_bytes);
  std::memcpy(start.data(), &header, sizeof header);
  sealHeader(start);
  writeBytes(path, start);
  std::filesystem::resize_file(path, bytes);
}

// Opening takes nothing of the table, and a row of zeros is none.
TEST(HostileFile, ATableOfATerabyteInAFileOfHolesCostsNothingAndIsRefusedRowByRow) {
  const DiskFolder folder;
  const std::string path = folder.file("hollow.isb");
  try {
    writeHollowFile(path, 8192, std::uint64_t{1} << 40);
  } catch (const std::filesystem::filesystem_error&) {
    SKIP_UNLESS_REQUIRED("no file of a terabyte with holes on this file system");
  }
  const int status = statusOfChild([&] {
    rusage before = {}, after = {};
    getrusage(RUSAGE_SELF, &before);
    const Pyramid pyramid(path);
    const Index3 last = pyramid.layout().bricks(0) - Index3(1);
    for (const Index3& brick : {Index3(0), last / std::int64_t{2}, last}) {
      try {
        pyramid.brickRange(0, brick);
        return 3;
      } catch (const Error& error) {
        if (std::string(error.what()).find(brickText(0, brick)) == std::string::npos) return 4;
      }
    }
    getrusage(RUSAGE_SELF, &after);
    return after.ru_maxrss - before.ru_maxrss < 16 * 1024 ? 0 : 5;
  });
  ASSERT_TRUE(WIFEXITED(status)) << "killed by signal " << WTERMSIG(status);
  EXPECT_EQ(WEXITSTATUS(status), 0);
}

TEST(HostileFile, AProvenanceOfAGigabyteIsRefused) {
  const DiskFolder folder;
  Bytes bytes = readWholeFile(buildTinyFile(folder));
  const std::string path = folder.file("long.isb");
  constexpr std::uint64_t kLong = std::uint64_t{1} << 30;
  putU64(bytes, kFileBytesAt, bytes.size() + kLong);
  putU64(bytes, 248, bytes.size());
  putU64(bytes, 256, kLong);
  sealHeader(bytes);
  writeBytes(path, bytes);
  std::filesystem::resize_file(path, bytes.size() + kLong);
  EXPECT_NE(judge(path).open_error.find("provenance of 1073741824 bytes"), std::string::npos);
}

// A file full of noise behind a sound header is no better than a damaged one.
TEST(HostileFile, ThingsThatAreNotPyramids) {
  const DiskFolder folder;
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
  for (const std::uint32_t version : {1, 2, 4}) {
    putU32(other, 8, version);
    sealHeader(other);
    writeBytes(bad, other);
    EXPECT_NE(judge(bad).open_error.find("format version " + std::to_string(version)),
              std::string::npos);
  }
}

// ---- a file that is cut while it is mapped ----

volatile std::uint64_t g_sink;  // keeps reads from being optimised away

// Reads all samples of the brick; 0: read, 1: an Error that names it, 2: another Error.
int readBrick(const Pyramid& pyramid, int level, const Index3& brick) {
  try {
    const BrickSamples samples = pyramid.samples(level, brick);
    const std::size_t bytes =
        static_cast<std::size_t>(samples.box.size()) * voxelBytes(pyramid.spec().voxel_type);
    std::uint64_t sum = 0;
    for (std::size_t i = 0; i < bytes; ++i)
      sum += static_cast<std::uint8_t>(samples.part.data()[i]);
    g_sink = sum;
    return 0;
  } catch (const Error& error) {
    return std::string(error.what()).find(brickText(level, brick)) != std::string::npos ? 1 : 2;
  }
}

std::string buildPagedFile(const DiskFolder& folder, format::Codec codec = format::Codec::kStored) {
  NoiseSource source(Index3(70, 40, 40), VoxelType::kUint16);
  BuildOptions options;
  options.brick_cells = 16;
  options.codec = codec;
  const std::string path = folder.file("paged.isb");
  buildPyramid(source, path, options);
  return path;
}

void checkBricksNotYetReadThrow(format::Codec codec) {
  const DiskFolder folder;
  const std::string path = buildPagedFile(folder, codec);
  // Between the parts of two bricks.
  const PlainPyramid plain = readPlainPyramid(path);
  const PlainPart& first_lost = plain.bricks[plain.bricks.size() / 2].parts[0];
  ASSERT_GT(first_lost.offset, 0u);
  const int status = statusOfChild([&] {
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
  ASSERT_TRUE(WIFEXITED(status)) << "killed by signal " << WTERMSIG(status);
  EXPECT_EQ(WEXITSTATUS(status), 0);
}

TEST(TruncatedWhileMapped, BricksNotYetReadThrow) {
  for (const format::Codec codec : kCodecs) checkBricksNotYetReadThrow(codec);
}

// The pager knows the brick as resident; the pages behind it are gone all the same.
void checkBricksReadBeforeThrow(format::Codec codec) {
  const DiskFolder folder;
  const std::string path = buildPagedFile(folder, codec);
  const int status = statusOfChild([&] {
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
  ASSERT_TRUE(WIFEXITED(status)) << "killed by signal " << WTERMSIG(status);
  EXPECT_EQ(WEXITSTATUS(status), 0)
      << "a brick that was resident did not end in an Error that names it";
}

TEST(TruncatedWhileMapped, BricksReadBeforeThrow) {
  for (const format::Codec codec : kCodecs) checkBricksReadBeforeThrow(codec);
}

// A brick that is held at that moment reads as zeros, and whoever used it is told.
TEST(TruncatedWhileMapped, HeldBricksAreErrorsAfterTheirUse) {
  const DiskFolder folder;
  const std::string path = buildPagedFile(folder);
  const int status = statusOfChild([&] {
    const Pyramid pyramid(path);
    const Index3 last = pyramid.layout().bricks(0) - Index3(1);
    const BrickSamples samples = pyramid.samples(0, last);
    pyramid.throwIfReadsFailed(0, last);  // all is well so far
    std::filesystem::resize_file(path, 512);
    g_sink = static_cast<std::uint8_t>(samples.part.data()[0]);
    try {
      pyramid.throwIfReadsFailed(0, last);
    } catch (const Error& error) {
      return std::string(error.what()).find(brickText(0, last)) != std::string::npos ? 0 : 4;
    }
    return 3;
  });
  ASSERT_TRUE(WIFEXITED(status)) << "killed by signal " << WTERMSIG(status);
  EXPECT_EQ(WEXITSTATUS(status), 0);
}

// What was unpacked is not touched by what happens to the file.
TEST(TruncatedWhileMapped, HeldPackedBricksStay) {
  const DiskFolder folder;
  const std::string path = buildPagedFile(folder, format::Codec::kZstd);
  const PlainPyramid plain = readPlainPyramid(path);
  const int status = statusOfChild([&] {
    const Pyramid pyramid(path);
    const PlainBrick& brick = plain.bricks.front();
    const BrickSamples samples = pyramid.samples(0, Index3(0));
    if (pyramid.parts().storedBytes(PartKind::kSamples, 0, Index3(0)) >= 2 * brick.samples.size())
      return 4;  // not packed
    std::filesystem::resize_file(path, 512);
    for (std::size_t i = 0; i < brick.samples.size(); ++i)
      if (static_cast<float>(samples.data<std::uint16_t>()[i]) != brick.samples[i]) return 3;
    pyramid.throwIfReadsFailed(0, Index3(0));
    return readBrick(pyramid, 0, Index3(0)) == 1 ? 0 : 5;
  });
  ASSERT_TRUE(WIFEXITED(status)) << "killed by signal " << WTERMSIG(status);
  EXPECT_EQ(WEXITSTATUS(status), 0);
}

// The file is cut at any moment of reading, checking and unpacking: what comes out is right, or
// somebody says that it is not.
int readWhileCut(const PlainPyramid& plain, const std::string& path, std::uint64_t spins) {
  const Pyramid pyramid(path, 64 * 1024);
  std::atomic<bool> is_cut{false};
  std::thread cutter([&] {
    for (std::uint64_t i = 0; i < spins; ++i) g_sink = i;
    std::filesystem::resize_file(path, 4096);
    is_cut = true;
  });
  int errors = 0;
  bool is_wrong = false;
  for (bool is_last = false; !is_last && !is_wrong;) {
    is_last = is_cut;  // once more over all bricks after the cut
    for (const PlainBrick& brick : plain.bricks) try {
        const BrickSamples samples =
            pyramid.samples(brick.level, {brick.index[0], brick.index[1], brick.index[2]});
        bool differs = false;
        for (std::size_t i = 0; i < brick.samples.size(); ++i)
          differs =
              differs || static_cast<float>(samples.data<std::uint16_t>()[i]) != brick.samples[i];
        pyramid.throwIfReadsFailed(brick.level, {brick.index[0], brick.index[1], brick.index[2]});
        is_wrong = is_wrong || differs;
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
    const std::string path = buildPagedFile(folder, codec);
    const Bytes good = readWholeFile(path);
    const PlainPyramid plain = readPlainPyramid(path);
    const int status = statusOfChild([&] {
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
    ASSERT_TRUE(WIFEXITED(status)) << "killed by signal " << WTERMSIG(status);
    EXPECT_EQ(WEXITSTATUS(status), 0) << codecName(codec);
  }
}

// ---- a file that is written to while it is open ----

// Somebody changes bytes of packed parts, and back again, all the time: what comes out is right, or
// an Error. A decoder that read the bytes after their checksum would see others.
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
      for (std::uint64_t spins = randomBelow(random, 8000); spins > 0; --spins) g_sink = spins;
      bytes[at] = good;
      for (std::uint64_t spins = randomBelow(random, 8000); spins > 0; --spins) g_sink = spins;
    }
  });
  int right = 0, errors = 0, wrong = 0;
  const Pyramid pyramid(path, 0);  // every time from the file
  for (int round = 0; round < 40000 && wrong == 0; ++round) try {
      const BrickSamples samples = pyramid.samples(0, Index3(0));
      bool differs = false;
      for (std::size_t i = 0; i < brick.samples.size(); ++i)
        differs =
            differs || static_cast<float>(samples.data<std::uint16_t>()[i]) != brick.samples[i];
      ++(differs ? wrong : right);
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

// ---- builds that fail ----

TEST(FailedBuild, WriterWithoutFinishLeavesNoFile) {
  const DiskFolder folder;
  PyramidSpec spec;
  spec.voxels = Index3(5);
  spec.brick_cells = 4;
  {
    PyramidWriter writer(folder.file("never.isb"), spec, "a test", false, nullptr);
    EncodedBrick brick;
    brick.samples.bytes.assign(125, std::byte{1});
    brick.ranges.bytes.assign(2, std::byte{1});
    encodeBrick(VoxelType::kUint8, format::Codec::kStored, brick);
    writer.write(brick);
    writer.flush();
    EXPECT_EQ(folder.names(),
              (std::vector<std::string>{"never.isb.partial", "never.isb.partial.journal"}));
    EXPECT_THROW(Pyramid(folder.file("never.isb.partial")), Error);
  }
  EXPECT_TRUE(folder.names().empty());
}

TEST(FailedBuild, LeavesTheOlderFileUntouched) {
  const DiskFolder folder;
  const std::string path = buildGoodFile(folder);
  const Bytes before = readWholeFile(path);
  NoiseSource source(Index3(19, 9, 40), VoxelType::kUint16);
  source.fail_at_row_ = 33 * 9;
  EXPECT_THROW(buildPyramid(source, path, smallBricks()), Error);
  EXPECT_TRUE(readWholeFile(path) == before);
  EXPECT_EQ(folder.names(), (std::vector<std::string>{"good.isb"}));

  for (const double stop_at : {0.0, 0.2, 0.5, 0.8}) {
    NoiseSource again(Index3(40, 30, 20), VoxelType::kUint16);
    BuildOptions options = smallBricks();
    CancelFlag cancel;
    options.cancel = &cancel;
    options.progress = [&](std::string_view, double fraction) {
      if (fraction >= stop_at) cancel.request();
    };
    EXPECT_THROW(buildPyramid(again, path, options), Cancelled) << stop_at;
    EXPECT_TRUE(readWholeFile(path) == before) << "stopped at " << stop_at;
    // What is left for --resume is no pyramid.
    for (const std::string& name : folder.names())
      if (name != "good.isb") {
        EXPECT_TRUE(name.starts_with("good.isb.partial")) << name;
        EXPECT_THROW(Pyramid(folder.file(name)), Error) << name;
      }
  }
}

TEST(FailedBuild, FoldersThatAreMissingAreNamed) {
  const DiskFolder folder;
  NoiseSource source(Index3(5), VoxelType::kUint8);
  const std::string path = folder.file("missing/out.isb");
  const std::string message = messageOfBuild(source, path, smallBricks());
  ASSERT_NE(message, "") << "no error";
  EXPECT_NE(message.find(path), std::string::npos) << message;
}

// A limit on the size of files fails at every point of the file in turn: bricks, tables.
TEST(FailedBuild, FileSizeLimitGivesOneErrorAndLeavesNothing) {
  const DiskFolder folder;
  NoiseSource source(Index3(40, 33, 30), VoxelType::kUint16);
  const std::string whole = folder.file("whole.isb");
  const std::uint64_t size = buildPyramid(source, whole, smallBricks()).file_bytes;
  rlimit before = {};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto old_handler = std::signal(SIGXFSZ, SIG_IGN);
  for (const std::uint64_t limit :
       {std::uint64_t{0}, std::uint64_t{100}, std::uint64_t{512}, std::uint64_t{5000}, size / 2,
        size - 20000, size - 5000, size - 1}) {
    rlimit lower = before;
    lower.rlim_cur = limit;
    ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &lower), 0);
    NoiseSource again(Index3(40, 33, 30), VoxelType::kUint16);
    const std::string message = messageOfBuild(again, folder.file("limited.isb"), smallBricks());
    setrlimit(RLIMIT_FSIZE, &before);  // before anything is printed
    EXPECT_NE(message.find("limited.isb"), std::string::npos) << limit << ": '" << message << "'";
    EXPECT_NE(message.find("limit"), std::string::npos) << limit << ": '" << message << "'";
    EXPECT_EQ(folder.names(), (std::vector<std::string>{"whole.isb"})) << limit;
  }
  std::signal(SIGXFSZ, old_handler);
}

// ---- BrickPager ----

constexpr std::uint64_t kPage = 4096;
constexpr std::uint64_t kFaultAround = 64 * 1024;  // Linux: fault_around_bytes

struct PagerFile {
  std::string path;
  std::vector<BrickPager::Part> parts;
  std::vector<std::uint8_t> fill;  // every byte of part i
};

// `count` parts of `bytes` bytes, each beginning at a multiple of `alignment`.
PagerFile makePagerFile(const DiskFolder& folder, std::size_t count, std::uint64_t bytes,
                        std::uint64_t alignment) {
  PagerFile result;
  result.path = folder.file("parts");
  Bytes all;
  for (std::size_t i = 0; i < count; ++i) {
    all.resize((all.size() + alignment - 1) / alignment * alignment);
    const auto value = static_cast<std::uint8_t>(1 + i % 250);
    const std::uint64_t offset = all.size();
    all.resize(offset + bytes, value);
    BrickPager::Part part;
    part.offset = offset;
    part.bytes = bytes;
    part.checksum = XXH3_64bits(all.data() + offset, bytes);
    result.parts.push_back(part);
    result.fill.push_back(value);
  }
  writeBytes(result.path, all);
  // A file that was just written lies in the page cache in blocks of up to 2 MiB, and the kernel
  // maps all of a block at the first touch. Read back cold it lies there page by page.
  const int fd = open(result.path.c_str(), O_RDONLY | O_CLOEXEC);
  fsync(fd);
  posix_fadvise(fd, 0, 0, POSIX_FADV_DONTNEED);
  close(fd);
  return result;
}

// Bytes of the mapping that the process holds now.
std::uint64_t residentBytesOf(const PagedFile& file) {
  std::ifstream maps("/proc/self/smaps");
  const auto begin = reinterpret_cast<std::uintptr_t>(file.data());
  std::string line;
  std::uint64_t resident = 0;
  bool inside = false;
  while (std::getline(maps, line)) {
    std::uintptr_t first = 0, end = 0;
    char dash = 0;
    std::istringstream range(line);
    if (line.find('-') < line.find(' ') && range >> std::hex >> first >> dash >> end)
      inside = first < begin + file.size() && end > begin;
    else if (inside && line.starts_with("Rss:"))
      resident += std::stoull(line.substr(4)) * 1024;
  }
  return resident;
}

// Of the pages around `bytes` bytes from `offset` that one fault may bring in together, the bytes
// that the process maps. Right after these were given back there are none, whatever the kernel maps
// around the pages that are touched next.
std::uint64_t mappedBytesAround(const PagedFile& file, std::uint64_t offset, std::uint64_t bytes) {
  const std::uint64_t begin = offset / kFaultAround * kFaultAround;
  const std::uint64_t end =
      std::min((offset + bytes + kFaultAround - 1) / kFaultAround * kFaultAround,
               (file.size() + kPage - 1) / kPage * kPage);
  std::vector<std::uint64_t> pages((end - begin) / kPage);
  const std::uint64_t first = (reinterpret_cast<std::uintptr_t>(file.data()) + begin) / kPage;
  const std::size_t wanted = pages.size() * sizeof pages[0];
  const int pagemap = open("/proc/self/pagemap", O_RDONLY | O_CLOEXEC);
  const ssize_t got =
      pread(pagemap, pages.data(), wanted, static_cast<off_t>(first * sizeof pages[0]));
  close(pagemap);
  if (got != static_cast<ssize_t>(wanted)) throw std::runtime_error("cannot read the page map");
  const auto is_mapped = [](std::uint64_t page) { return page >> 63 != 0; };
  return kPage * static_cast<std::uint64_t>(std::count_if(pages.begin(), pages.end(), is_mapped));
}
std::uint64_t mappedBytesAround(const PagedFile& file, const BrickPager::Part& part) {
  return mappedBytesAround(file, part.offset, part.bytes);
}

// False where one touched page maps far neighbours too (tmpfs, or a file that stayed in the page
// cache in large blocks): then the resident bytes of the whole file say little about the pager, and
// the tests compare them with nothing. Ends with nothing resident.
bool kernelMapsSinglePages(const PagedFile& file) {
  g_sink = static_cast<std::uint8_t>(file.data()[0]);
  const bool single = residentBytesOf(file) <= kPage;
  file.release(0, file.size() / kPage * kPage);
  return single;
}

const std::byte* mustAcquire(BrickPager& pager, std::size_t id) {
  const char* why = "";
  const std::byte* data = pager.acquire(id, &why);
  if (data == nullptr) throw std::runtime_error(why);
  return data;
}

TEST(BrickPager, KeepsTheBudget) {
  const DiskFolder folder;
  const PagerFile made = makePagerFile(folder, 200, 4 * kPage, kPage);
  const PagedFile file(made.path);
  const std::uint64_t budget = 10 * 4 * kPage;
  const bool single_pages = kernelMapsSinglePages(file);
  BrickPager pager(file, made.parts, budget);
  for (std::size_t i = 0; i < made.parts.size(); ++i) {
    const std::byte* const data = mustAcquire(pager, i);
    ASSERT_LE(pager.heldBytes(), budget);
    if (i >= 10) {  // the one that had to go for it
      ASSERT_EQ(mappedBytesAround(file, made.parts[i - 10]), 0u) << i;
    }
    EXPECT_EQ(static_cast<std::uint8_t>(data[kPage]), made.fill[i]);
    ASSERT_GT(mappedBytesAround(file, made.parts[i]), 0u) << i;
    pager.release(i);
    if (single_pages) {
      ASSERT_LE(residentBytesOf(file), budget) << "after part " << i;
    }
  }
  const BrickPager::Counters counters = pager.counters();
  EXPECT_EQ(counters.parts_read, 200u);
  EXPECT_EQ(counters.bytes_read, 200 * 4 * kPage);
  EXPECT_EQ(counters.parts_released, 190u);
  // The last ten are still in, the others are not.
  for (std::size_t i = 190; i < 200; ++i) {
    mustAcquire(pager, i);
    pager.release(i);
  }
  EXPECT_EQ(pager.counters().parts_read, 200u);
  mustAcquire(pager, 0);
  pager.release(0);
  EXPECT_EQ(pager.counters().parts_read, 201u);
}

// At a fault the kernel maps whatever of the aligned 64 KiB around lies in the page cache, and
// tile ranges and curvature share their first and last pages with neighbours. What a part brought
// in must go with it, or the process ends up holding the whole file: a 2048^3 volume has 10^5
// parts.
TEST(BrickPager, KeepsTheBudgetAmongCachedNeighbours) {
  const DiskFolder folder;
  const std::uint64_t bytes = 8200;
  const PagerFile made = makePagerFile(folder, 4000, bytes, 64);
  const PagedFile file(made.path);
  const bool single_pages = kernelMapsSinglePages(file);
  const std::uint64_t budget = 20 * bytes;
  BrickPager pager(file, made.parts, budget);
  Random random(14);
  std::vector<std::size_t> order(made.parts.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::shuffle(order.begin(), order.end(), random);
  for (std::size_t n = 0; n < order.size(); ++n) {
    const std::size_t i = order[n];
    const std::byte* const data = mustAcquire(pager, i);
    if (n >= 20) {
      ASSERT_EQ(mappedBytesAround(file, made.parts[order[n - 20]]), 0u) << n;
    }
    EXPECT_EQ(static_cast<std::uint8_t>(*data), made.fill[i]);
    pager.release(i);
  }
  if (single_pages) {
    EXPECT_LE(residentBytesOf(file), budget + 20 * 2 * kFaultAround) << "the budget is " << budget;
  }
}

TEST(BrickPager, NestedHoldsStayResident) {
  const DiskFolder folder;
  const PagerFile made = makePagerFile(folder, 8, 64 * kPage, kPage);
  const PagedFile file(made.path);
  const bool single_pages = kernelMapsSinglePages(file);
  BrickPager pager(file, made.parts, 0);  // nothing may stay that is not in use
  const std::byte* data = mustAcquire(pager, 3);
  EXPECT_EQ(mustAcquire(pager, 3), data);
  EXPECT_EQ(mustAcquire(pager, 3), data);
  EXPECT_EQ(pager.counters().parts_read, 1u);
  pager.release(3);
  pager.release(3);
  EXPECT_EQ(pager.counters().parts_released, 0u);
  // More is in use than the budget allows: nothing waits, nothing in use goes.
  mustAcquire(pager, 4);
  EXPECT_EQ(pager.counters().parts_released, 0u);
  EXPECT_EQ(static_cast<std::uint8_t>(data[5]), made.fill[3]);
  EXPECT_GT(mappedBytesAround(file, made.parts[3]), 0u);
  pager.release(3);
  EXPECT_EQ(pager.counters().parts_released, 1u);
  EXPECT_EQ(mappedBytesAround(file, made.parts[3]), 0u);
  pager.release(4);
  EXPECT_EQ(pager.counters().parts_released, 2u);
  EXPECT_EQ(mappedBytesAround(file, made.parts[4]), 0u);
  if (single_pages) {
    EXPECT_LE(residentBytesOf(file), kFaultAround);
  }
  mustAcquire(pager, 3);
  pager.release(3);
  EXPECT_EQ(pager.counters().parts_read, 3u);
}

TEST(BrickPager, LetsTheOldestGoFirst) {
  const DiskFolder folder;
  const PagerFile made = makePagerFile(folder, 6, kPage, kPage);
  const PagedFile file(made.path);
  BrickPager pager(file, made.parts, 3 * kPage);
  const auto touch = [&](std::size_t id) {
    mustAcquire(pager, id);
    pager.release(id);
    return pager.counters().parts_read;
  };
  touch(0), touch(1), touch(2);
  EXPECT_EQ(touch(0), 3u);  // 0 is now the newest, 1 the oldest
  EXPECT_EQ(touch(3), 4u);  // 1 goes
  EXPECT_EQ(touch(0), 4u);
  EXPECT_EQ(touch(2), 4u);
  EXPECT_EQ(touch(1), 5u);
}

TEST(BrickPager, DamageIsSaidEveryTime) {
  const DiskFolder folder;
  PagerFile made = makePagerFile(folder, 3, kPage, kPage);
  made.parts[1].checksum ^= 1;
  const PagedFile file(made.path);
  BrickPager pager(file, made.parts, 10 * kPage);
  for (int round = 0; round < 2; ++round) {
    const char* why = "";
    EXPECT_EQ(pager.acquire(1, &why), nullptr);
    EXPECT_NE(std::string(why).find("checksum"), std::string::npos) << why;
  }
  EXPECT_EQ(pager.counters().parts_read, 0u);
}

// The same through Pyramid: several readers, a budget of a few bricks, every value checked.
void readWithinABudget(format::Codec codec) {
  const DiskFolder folder;
  const std::string path = buildPagedFile(folder, codec);
  const PlainPyramid plain = readPlainPyramid(path);
  const Pyramid pyramid(path, 64 * 1024);
  std::atomic<int> wrong{0};
  std::vector<std::thread> threads;
  for (std::uint64_t t = 0; t < 3; ++t)
    threads.emplace_back([&, t] {
      Random random(t);
      for (int round = 0; round < 300; ++round) {
        const PlainBrick& brick = plain.bricks[randomBelow(random, plain.bricks.size())];
        const BrickSamples samples =
            pyramid.samples(brick.level, {brick.index[0], brick.index[1], brick.index[2]});
        for (std::size_t i = 0; i < brick.samples.size(); ++i)
          if (static_cast<float>(samples.data<std::uint16_t>()[i]) != brick.samples[i]) {
            ++wrong;
            break;
          }
      }
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(pyramid.parts().counters().parts_released, 0u);
}

TEST(BrickPager, PyramidReadersWithinABudget) {
  for (const format::Codec codec : kCodecs) readWithinABudget(codec);
}

}  // namespace
}  // namespace isobrick::test
