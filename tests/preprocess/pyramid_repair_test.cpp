// Damaged pyramids are repaired to the bytes that they had, or what stays lost is named.
// ISOBRICK_REPETITIONS=1000 makes it ten thousand random damages.
#include "isobrick/preprocess/pyramid_repair.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <map>

#include "isobrick/storage/file_system.h"
#include "isobrick/storage/format.h"
#include "isobrick/storage/pyramid_verify.h"
#include "tests/support/file_bytes.h"
#include "tests/support/file_edits.h"
#include "tests/support/golden_pyramid.h"
#include "tests/support/pyramid_kinds.h"
#include "tests/support/random_numbers.h"
#include "tests/support/repetitions.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/test_paths.h"

namespace isobrick::test {
namespace {

bool isWhole(const std::string& path) try {
  VerifyOptions options;
  options.threads = 1;
  return verifyPyramid(Pyramid(path), options).empty();
} catch (const Error&) {
  return false;
}

std::uint64_t headerField(const std::string& bytes, std::size_t at) {
  std::uint64_t value = 0;
  bytes.copy(reinterpret_cast<char*>(&value), sizeof value, at);
  return value;
}

// Bits flipped, a run of zeros or of noise, a cut, or bytes too many; anywhere, or in header or
// tables.
std::string randomlyDamaged(Random& random, const std::string& good) {
  std::string bad = good;
  const std::uint64_t tables = headerField(good, offsetof(format::Header, brick_table_offset));
  const std::uint64_t first = randomBelow(random, 4) == 0 ? tables : 0;
  const std::uint64_t end = randomBelow(random, 6) == 0 ? sizeof(format::Header) : good.size();
  const auto place = [&] {
    return first < end ? first + randomBelow(random, end - first) : randomBelow(random, end);
  };
  const std::uint64_t at = place();
  const std::uint64_t bytes = std::min(1 + randomBelow(random, 300), bad.size() - at);
  switch (randomBelow(random, 8)) {
    case 0:
      return bad.substr(0, at);
    case 1:
      return bad + std::string(bytes, '\1');
    case 2:
    case 3:
      return bad.replace(at, bytes, bytes, '\0');
    case 4:
      for (std::uint64_t i = at; i < at + bytes; ++i) bad[i] = static_cast<char>(random());
      return bad;
    default:
      for (std::uint64_t flips = 1 + randomBelow(random, 4); flips > 0; --flips) {
        const std::uint64_t where = place();
        bad[where] = static_cast<char>(bad[where] ^ 1 << randomBelow(random, 8));
      }
      return bad;
  }
}

class Repair : public testing::TestWithParam<PyramidKind> {
 protected:
  Repair() {
    for (const std::string& file : filesOfPyramid(path_)) good_[file] = readBytes(file);
  }

  RepairOptions withSource(int seed = 0) const {
    RepairOptions options;
    options.open_source = [seed](const std::string&) {
      auto source = std::make_unique<KindSource>(GetParam());
      source->seed = seed;
      return source;
    };
    return options;
  }
  // Whether all files are as they were, and no other is there.
  bool isAsItWas() const {
    if (filesOfPyramid(path_).size() != good_.size() || folder_.names().size() != 1) return false;
    return std::all_of(good_.begin(), good_.end(),
                       [](const auto& file) { return readBytes(file.first) == file.second; });
  }
  void putBack() const {
    for (const auto& [file, bytes] : good_) writeBytes(file, bytes);
  }
  // A level 0 brick's samples, of the file that has them.
  std::pair<std::string, std::size_t> placeInLevel0() const {
    for (const auto& [file, bytes] : good_) {
      const std::size_t row = headerField(bytes, offsetof(format::Header, brick_table_offset));
      if (headerField(bytes, row) > 0) return {file, headerField(bytes, row) + 5};
    }
    return {};
  }
  void flip(const std::string& file, std::size_t at) const {
    std::string bad = readBytes(file);
    bad[at] = static_cast<char>(bad[at] ^ 4);
    writeBytes(file, bad);
  }

  const TemporaryFolder folder_;
  const std::string path_ = buildKind(GetParam(), folder_);
  std::map<std::string, std::string> good_;
};

TEST_P(Repair, GivesTheSameBytesOrNamesWhatIsLost) {
  Random random(52);
  const int rounds = repetitions(100);
  int repaired[2] = {}, named[2] = {}, headless[2] = {};
  for (int round = 0; round < rounds; ++round) {
    SCOPED_TRACE("round " + std::to_string(round));
    const bool has_source = round % 2 == 0;
    auto file = good_.begin();
    std::advance(file, randomBelow(random, good_.size()));
    const std::string bad = randomlyDamaged(random, file->second);
    if (bad == file->second) continue;
    writeBytes(file->first, bad);
    bool is_named = false;
    try {
      const RepairReport report = repairPyramid(path_, has_source ? withSource() : RepairOptions());
      is_named = !report.lost.empty() || !report.losses.empty();
    } catch (const Error& error) {
      is_named = true;
      ++headless[has_source];
      EXPECT_NE(std::string(error.what()).find("no header"), std::string::npos);
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos) << error.what();
      EXPECT_TRUE(readBytes(file->first) == bad);
    }
    if (isAsItWas()) {
      ++repaired[has_source];
    } else {
      ++named[has_source];
      EXPECT_TRUE(is_named);
    }
    putBack();
  }
  std::printf(
      "%s: with the source %d repaired, %d named (%d without a header); without %d repaired, %d "
      "named (%d)\n",
      GetParam().name, repaired[1], named[1], headless[1], repaired[0], named[0], headless[0]);
  // An index has its source in its provenance.
  if (!GetParam().is_index) {
    EXPECT_EQ(named[1], headless[1]);
  }
  EXPECT_GT(repaired[1], named[1]);
}

TEST_P(Repair, TakesLevel0FromTheSource) {
  if (GetParam().is_index) return;  // it has no level 0 of its own
  const auto [file, at] = placeInLevel0();
  flip(file, at);
  const RepairReport named = repairPyramid(path_, {});
  ASSERT_EQ(named.lost.size(), 1u);
  EXPECT_GT(named.lost[0].voxels.size(), 0);
  EXPECT_TRUE(!isWhole(path_));
  const RepairReport report = repairPyramid(path_, withSource());
  EXPECT_TRUE(report.lost.empty() && report.losses.empty());
  EXPECT_TRUE(isAsItWas());
}

TEST_P(Repair, MakesTheTextOfItsOriginAgainFromTheSourceAlone) {
  const auto& [file, good] = *good_.begin();
  for (const std::size_t from_end : {3u, 30u}) flip(file, good.size() - from_end);
  const std::string bad = readBytes(file);
  const RepairReport report = repairPyramid(path_, withSource());
  EXPECT_EQ(report.losses.empty(), !GetParam().is_index);
  if (GetParam().is_index)  // its place is in that text
    EXPECT_TRUE(readBytes(file) == bad);
  else
    EXPECT_TRUE(isAsItWas());
}

TEST_P(Repair, RefusesAnotherSource) {
  if (GetParam().is_index) return;  // it has no level 0 of its own
  const auto [file, at] = placeInLevel0();
  flip(file, at);
  const std::string bad = readBytes(file);
  const RepairReport report = repairPyramid(path_, withSource(3));
  ASSERT_EQ(report.losses.size(), 1u);
  EXPECT_NE(report.losses[0].find("other voxels"), std::string::npos) << report.losses[0];
  EXPECT_EQ(report.lost.size(), 1u);
  EXPECT_TRUE(readBytes(file) == bad);
  RepairOptions smaller;
  smaller.open_source = [](const std::string&) {
    PyramidKind kind = GetParam();
    kind.type = kind.type == VoxelType::kInt8 ? VoxelType::kUint8 : VoxelType::kInt8;
    kind.has_missing = false;
    return std::make_unique<KindSource>(kind);
  };
  EXPECT_NE(repairPyramid(path_, smaller).losses.at(0).find("type of voxels"), std::string::npos);
  EXPECT_TRUE(readBytes(file) == bad);
}

TEST_P(Repair, LeavesTheOldFileIfItIsInterrupted) {
  const auto& [file, good] = *good_.begin();
  flip(file, good.size() - 3);  // the provenance
  const std::string bad = readBytes(file);
  int calls = 0;
  for (int last = 0; last < 200; ++last) {
    CancelFlag cancel;
    RepairOptions options = withSource();
    options.cancel = &cancel;
    calls = 0;
    options.progress = [&](std::string_view, double) {
      if (calls++ == last) cancel.request();
    };
    try {
      repairPyramid(path_, options);
      break;
    } catch (const Cancelled&) {
      EXPECT_TRUE(readBytes(file) == bad || readBytes(file) == good);
      EXPECT_EQ(filesOfPyramid(path_).size(), good_.size());
      EXPECT_EQ(folder_.names().size(), 1u);
    }
  }
  EXPECT_GT(calls, 0);
  EXPECT_TRUE(isAsItWas());
}

INSTANTIATE_TEST_SUITE_P(Kinds, Repair, testing::ValuesIn(kPyramidKinds),
                         [](const auto& kind) { return std::string(kind.param.name); });

// Files of earlier versions and programs: what a part's checksum proves is put back.
TEST(RepairOfEarlierFiles, PutsBackWhatChecksumsProve) {
  for (const std::string name :
       {"u8-none", "f32-none", "i16-none", "errors-i8-none", "cells-u8-none"}) {
    const TemporaryFolder folder;
    const std::string path = folder.file("old.isb"),
                      good = readBytes(goldenFolder() + "/" + name + ".isb");
    // Ranges of the first brick that has some, and the level table.
    std::size_t row = headerField(good, offsetof(format::Header, brick_table_offset));
    const std::size_t row_bytes =
        format::rowBytes(static_cast<std::uint8_t>(good[offsetof(format::Header, kind_count)]));
    while (headerField(good, row + 24) == 0) row += row_bytes;
    for (const std::uint64_t at :
         {headerField(good, row + 24) + 1,
          headerField(good, offsetof(format::Header, level_table_offset)) + 2}) {
      std::string bad = good;
      bad[at] = static_cast<char>(bad[at] ^ 1);
      bad[at + 1] = static_cast<char>(bad[at + 1] ^ 1);
      writeBytes(path, bad);
      repairPyramid(path, {});
      EXPECT_TRUE(readBytes(path) == good) << name << ", byte " << at;
    }
  }
}

// Numbers that lie, under a checksum that fits: an error, a loss, or another pyramid.
TEST(RepairOfHostileFiles, HeadersThatLieDoNoHarm) {
  const TemporaryFolder folder;
  const std::string path = buildKind(kPyramidKinds[3], folder), good = readBytes(path);
  int harmless = 0;
  for (std::size_t at = 8; at < kHeaderChecksumAt; at += 4)
    for (const std::uint32_t number : {0u, 1u, 2u, 8u, 256u, 4096u, 0x7fffffffu, 0xffffffffu}) {
      Bytes bytes(good.begin(), good.end());
      putU32(bytes, at, number);
      sealHeader(bytes);
      writeBytes(path, std::string(bytes.begin(), bytes.end()));
      try {
        repairPyramid(path, {});
      } catch (const Error& error) {
        EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos) << error.what();
      }
      ++harmless;
    }
  EXPECT_EQ(harmless, 124 * 8);
  EXPECT_EQ(folder.names().size(), 1u);
}

TEST(RepairOfEarlierFiles, RefusesWhatIsNoPyramid) {
  const TemporaryFolder folder;
  const std::string path = folder.file("old.isb");
  for (const std::string& bytes :
       {std::string(), std::string(5000, 'I'), std::string("ISOBRICK")}) {
    writeBytes(path, bytes);
    EXPECT_THROW(repairPyramid(path, {}), Error);
    EXPECT_TRUE(readBytes(path) == bytes);
  }
  std::string old = readBytes(goldenFolder() + "/u8-none.isb");
  old[8] = 2;  // the version, under a checksum that fits
  Bytes sealed(old.begin(), old.end());
  sealHeader(sealed);
  writeBytes(path, std::string(sealed.begin(), sealed.end()));
  EXPECT_THROW(repairPyramid(path, {}), Error);
}

}  // namespace
}  // namespace isobrick::test
