// Parts that contradict the brick's own samples, in files whose checksums are right: verify finds
// them.

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid.h"
#include "tests/support/every_brick.h"
#include "tests/support/file_edits.h"
#include "tests/support/noise_pyramid.h"
#include "tests/support/plain_reader.h"
#include "tests/support/pyramid_verdict.h"
#include "tests/support/random_numbers.h"
#include "tests/support/sealed_pyramid.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

using Elements = PyramidDraft::Elements;

// Rewrites the elements of one brick, seals the file and returns what verify says of it.
Verdict judgeWithEdit(const TemporaryFolder& folder, PyramidDraft draft, std::size_t row,
                      const std::function<void(Elements&)>& edit) {
  PyramidDraft::Brick& brick = draft.bricks[row];
  Elements elements = draft.elementsOf(brick);
  edit(elements);
  draft.setElements(brick, elements, format::Codec::kStored);
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

TEST(HostileParts, ADraftThatWasNotChangedIsGood) {
  const TemporaryFolder folder;
  for (const format::Codec codec : kCodecs) {
    const std::string path = buildGoodFile(folder, VoxelType::kInt16, codec);
    PyramidDraft draft(readWholeFile(path));
    for (PyramidDraft::Brick& brick : draft.bricks)
      draft.setElements(brick, draft.elementsOf(brick), format::Codec::kStored);
    writeBytes(path, draft.seal());
    EXPECT_TRUE(judge(path).isGood());
  }
}

// Makes one tile's range a single value, one of its ends. False if it is one already.
bool narrowOne(Random& random, Elements& elements) {
  std::vector<std::byte>& ranges = elements[1];
  const std::size_t end = randomBelow(random, ranges.size() / 2);
  const auto other_end = elementAt<std::uint16_t>(ranges, end ^ 1);
  if (elementAt<std::uint16_t>(ranges, end) == other_end) return false;
  setElement(ranges, end, other_end);
  return true;
}

TEST(HostileParts, TileRangesThatLackTheirOwnSamplesAreFound) {
  const TemporaryFolder folder;
  const PyramidDraft good(
      readWholeFile(buildGoodFile(folder, VoxelType::kUint16, format::Codec::kStored)));
  Random random(21);
  std::size_t narrowed = 0, named = 0;
  for (std::size_t row = 0; row < good.bricks.size(); ++row)
    for (int round = 0; round < 8; ++round) {
      bool is_narrow = false;
      const Verdict verdict = judgeWithEdit(
          folder, good, row, [&](Elements& elements) { is_narrow = narrowOne(random, elements); });
      ASSERT_EQ(verdict.open_error, "");
      narrowed += is_narrow ? 1 : 0;
      named += verdict.damaged == std::vector<std::size_t>{row} ? 1 : 0;
    }
  EXPECT_GT(narrowed, 40u);
  // A tile's own samples may all be one value, beside coarser ones that are not.
  EXPECT_GT(10 * named, 9 * narrowed);
}

TEST(HostileParts, SamplesThatAreNotFiniteAreFound) {
  const TemporaryFolder folder;
  const PyramidDraft good(
      readWholeFile(buildGoodFile(folder, VoxelType::kFloat32, format::Codec::kStored)));
  Random random(22);
  using Limits = std::numeric_limits<float>;
  for (const float value : {Limits::quiet_NaN(), Limits::infinity(), -Limits::infinity()})
    for (int round = 0; round < 10; ++round) {
      const std::size_t row = randomBelow(random, 3);
      const Verdict verdict = judgeWithEdit(folder, good, row, [&](Elements& elements) {
        // In an apron too.
        setElement(elements[0], randomBelow(random, elements[0].size() / 4), value);
      });
      ASSERT_EQ(verdict.damaged, (std::vector<std::size_t>{row})) << value;
    }
}

TEST(HostileParts, ReservedFieldsAndValueRangesThatLieAreFound) {
  const TemporaryFolder folder;
  const Bytes good = readWholeFile(buildGoodFile(folder));
  const std::string bad = folder.file("bad.isb");
  const auto judgeDraft = [&](const std::function<void(PyramidDraft&)>& edit) {
    PyramidDraft draft(good);
    edit(draft);
    writeBytes(bad, draft.seal());
    return judge(bad);
  };
  EXPECT_TRUE(judgeDraft([](PyramidDraft&) {}).isGood());
  EXPECT_EQ(judgeDraft([](PyramidDraft& d) { d.header.reserved[41] = 1; }).rest.size(), 1u);
  // Another range is not that of the voxels, and the histogram is of another size.
  EXPECT_EQ(judgeDraft([](PyramidDraft& d) { d.header.value_max += 1; }).rest.size(), 2u);
  EXPECT_EQ(judgeDraft([](PyramidDraft& d) { d.header.kinds[7] = 1; }).rest.size(), 1u);
  EXPECT_EQ(judgeDraft([](PyramidDraft& d) { d.header.reserved_between[3] = 1; }).rest.size(), 1u);
  EXPECT_EQ(judgeDraft([](PyramidDraft& d) { d.header.error_bins[5] = 1; }).rest.size(), 1u);
  EXPECT_EQ(judgeDraft([](PyramidDraft& d) { d.bricks[2].row.unused = 1; }).damaged,
            (std::vector<std::size_t>{2}));
  EXPECT_EQ(judgeDraft([](PyramidDraft& d) {
              d.bricks[0].row.range_max = d.bricks[0].row.range_min;
            }).damaged,
            (std::vector<std::size_t>{0}));
}

// The checks of a row come before those of its bytes, whose checksums are right here.
TEST(HostileParts, RowsThatContradictTheFormatAreRefusedByTheReaderItself) {
  const TemporaryFolder folder;
  const PyramidDraft good(
      readWholeFile(buildGoodFile(folder, VoxelType::kUint8, format::Codec::kStored)));
  const Bytes file = good.seal();
  const std::string bad = folder.file("bad.isb");
  const auto rowOf = [&](std::uint32_t codec) {
    std::size_t row = 0;
    while (good.bricks[row].row.parts[0].codec != codec) ++row;
    return row;
  };
  const auto errorOf = [&](std::size_t row, const std::function<void(std::uint8_t*)>& edit) {
    Bytes bytes = file;
    edit(bytes.data() + getU64(bytes, kBrickTableAt) + row * kBrickRowBytes);
    sealChecksums(bytes);
    writeBytes(bad, bytes);
    const Pyramid pyramid(bad);
    try {
      pyramid.samples(good.bricks[row].level, good.bricks[row].index);
    } catch (const Error& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  const auto expectError = [](const std::string& error, const char* text) {
    EXPECT_NE(error.find(text), std::string::npos) << text << ": " << error;
  };
  const std::size_t stored = rowOf(0), constant = rowOf(1);
  EXPECT_EQ(errorOf(stored, [](std::uint8_t*) {}), "");
  expectError(errorOf(stored, [](std::uint8_t* at) { at[0] += 8; }), "impossible entry");
  // The sum of offset and size is small.
  expectError(errorOf(stored,
                      [](std::uint8_t* at) {
                        std::memset(at, 0xff, 8);
                        at[0] = 0xc0;
                      }),
              "impossible entry");
  const float beyond = good.bricks[constant].row.range_max + 1;
  expectError(
      errorOf(constant, [&](std::uint8_t* at) { std::memcpy(at + 80, &beyond, sizeof beyond); }),
      "impossible constant");
}

TEST(HostileParts, ThatOverlapAreFound) {
  const TemporaryFolder folder;
  const Bytes good = PyramidDraft(readWholeFile(buildGoodFile(folder))).seal();
  const std::string bad = folder.file("bad.isb");
  Bytes bytes = good;
  // The ranges of the first brick begin where its samples do.
  const std::uint64_t row = getU64(bytes, kBrickTableAt);
  putU64(bytes, row + sizeof(format::PartEntry), getU64(bytes, row));
  sealChecksums(bytes);
  writeBytes(bad, bytes);
  const Verdict verdict = judge(bad);
  EXPECT_TRUE(std::ranges::any_of(verdict.rest, [](const std::string& fault) {
    return fault.find("overlap") != std::string::npos;
  }));
}

TEST(HostileParts, CodesOfBlocksOfOneValueAreFound) {
  const TemporaryFolder folder;
  const PyramidDraft good(readWholeFile(buildGoodFile(folder)));
  std::size_t row = 0;
  while (good.bricks[row].row.part(PartKind::kRanges).codec !=
         static_cast<std::uint32_t>(format::Codec::kConstant))
    ++row;
  ASSERT_EQ(good.bricks[row].level, 0);
  const Verdict verdict = judgeWithEdit(
      folder, good, row, [](Elements& elements) { elements[2].back() = std::byte{5}; });
  EXPECT_EQ(verdict.damaged, std::vector<std::size_t>{row});
}

TEST(HostileParts, AHistogramThatLacksAVoxelIsFound) {
  const TemporaryFolder folder;
  PyramidDraft draft(
      readWholeFile(buildGoodFile(folder, VoxelType::kUint8, format::Codec::kStored)));
  *std::ranges::max_element(draft.histogram) -= 1;
  const std::string bad = folder.file("bad.isb");
  writeBytes(bad, draft.seal());
  const Verdict verdict = judge(bad);
  ASSERT_EQ(verdict.rest.size(), 1u);
  EXPECT_NE(verdict.rest[0].find("damaged histogram"), std::string::npos) << verdict.rest[0];
}

// A later version may add parts of a kind that this one does not know.
TEST(HostileParts, PartsOfUnknownKindsArePassedOver) {
  const TemporaryFolder folder;
  const std::string path = buildGoodFile(folder);
  PyramidDraft draft(readWholeFile(path));
  ASSERT_EQ(draft.header.kind_count, 3u);
  draft.header.kinds[draft.header.kind_count++] = 77;
  draft.header.kinds[draft.header.kind_count++] = 0xffffffff;
  const std::string later = folder.file("later.isb");
  writeBytes(later, draft.seal());
  EXPECT_TRUE(judge(later).isGood());
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

}  // namespace
}  // namespace isobrick::test
