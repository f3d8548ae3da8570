// buildPyramid writes the format of docs/FORMAT.md: a reader made from that page alone
// (plain_reader) gets every value back, and it is the value that the slow reference computes.

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>
#include <random>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/storage/pyramid.h"
#include "isobrick/storage/pyramid_parts.h"
#include "isobrick/storage/pyramid_verify.h"
#include "tests/support/array_source.h"
#include "tests/support/build_message.h"
#include "tests/support/plain_bricks.h"
#include "tests/support/plain_reader.h"
#include "tests/support/random_numbers.h"
#include "tests/support/reference_pyramid.h"
#include "tests/support/repetitions.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

// Full-range noise (every rounding matters), or a few values (plateaus, equal tiles), or a blob on
// a constant background (constant bricks beside others).
template <typename T>
std::vector<T> randomVoxels(Random& random, const Index3& dims, int kind) {
  std::vector<T> voxels(static_cast<std::size_t>(elementCount(dims)));
  const auto draw = [&]() -> T {
    if constexpr (std::is_floating_point_v<T>)
      return std::uniform_real_distribution<T>(-1000, 1000)(random);
    else
      return static_cast<T>(
          randomInt(random, std::numeric_limits<T>::min(), std::numeric_limits<T>::max()));
  };
  const T palette[2] = {draw(), draw()};
  for (std::size_t i = 0; i < voxels.size(); ++i) {
    const auto x = static_cast<std::int64_t>(i) % dims.x;
    voxels[i] = kind == 0        ? draw()
                : kind == 1      ? palette[randomInt(random, 0, 1)]
                : x < dims.x / 3 ? draw()
                                 : palette[0];
  }
  return voxels;
}

PlainIndex plain(const Index3& v) { return {v.x, v.y, v.z}; }

std::string textOf(const PlainIndex& v) {
  std::ostringstream text;
  text << "(" << v[0] << "," << v[1] << "," << v[2] << ")";
  return text.str();
}

// Every sample of the levels 0 .. `last_level` in the closed cube of the cells [first, end) of
// `level`, found by comparing positions: no arithmetic shared with preprocess/node_ranges.
PlainRange closureByBruteForce(const ReferencePyramid& reference, int level,
                               const PlainIndex& first, const PlainIndex& end, int last_level) {
  const Lattice& lattice = reference.lattice;
  PlainRange range{std::numeric_limits<float>::infinity(), -std::numeric_limits<float>::infinity()};
  for (int l = 0; l <= std::min(last_level, lattice.levels() - 1); ++l) {
    std::vector<std::int64_t> inside[3];
    for (int axis = 0; axis < 3; ++axis) {
      const std::int64_t last_voxel = lattice.voxels()[axis] - 1;
      const auto a = static_cast<std::size_t>(axis);
      const std::int64_t low = first[a] << level;
      const std::int64_t high = std::min(end[a] << level, last_voxel);
      for (std::int64_t i = 0; i < lattice.samples(l)[axis]; ++i) {
        const std::int64_t at = std::min(i << l, last_voxel);
        if (at >= low && at <= high) inside[axis].push_back(i);
      }
    }
    for (const std::int64_t z : inside[2])
      for (const std::int64_t y : inside[1])
        for (const std::int64_t x : inside[0]) {
          const float v = reference.sampleAt(l, {x, y, z});
          range.min = std::min(range.min, v);
          range.max = std::max(range.max, v);
        }
  }
  return range;
}

int log2Of(std::int64_t power) {
  int log = 0;
  while ((std::int64_t{1} << log) < power) ++log;
  return log;
}

// Compares one brick, as the plain reader has it, with the reference; false after the first fault.
bool brickIsRight(const PlainPyramid& p, const PlainBrick& brick, const ReferencePyramid& reference,
                  const std::string& name) {
  PlainIndex s;
  for (s[2] = 0; s[2] < brick.count[2]; ++s[2])
    for (s[1] = 0; s[1] < brick.count[1]; ++s[1])
      for (s[0] = 0; s[0] < brick.count[0]; ++s[0]) {
        const PlainIndex at = {brick.first_sample[0] + s[0], brick.first_sample[1] + s[1],
                               brick.first_sample[2] + s[2]};
        const float expected = reference.sampleAt(brick.level, {at[0], at[1], at[2]});
        if (brick.sampleAt(at) != expected) {
          ADD_FAILURE() << name << ": sample " << textOf(at) << " is " << brick.sampleAt(at)
                        << ", not " << expected;
          return false;
        }
      }
  const auto end = [&](const PlainIndex& first, std::int64_t cells) {
    PlainIndex result;
    for (std::size_t a = 0; a < 3; ++a)
      result[a] = std::min(first[a] + cells, brick.first_cell[a] + brick.cells[a]);
    return result;
  };
  const PlainRange whole = closureByBruteForce(reference, brick.level, brick.first_cell,
                                               end(brick.first_cell, p.brick_cells),
                                               brick.level + log2Of(p.brick_cells));
  if (!(brick.range == whole)) {
    ADD_FAILURE() << name << ": range " << brick.range.min << " .. " << brick.range.max << ", not "
                  << whole.min << " .. " << whole.max;
    return false;
  }
  PlainIndex t;
  for (t[2] = 0; t[2] < brick.tiles[2]; ++t[2])
    for (t[1] = 0; t[1] < brick.tiles[1]; ++t[1])
      for (t[0] = 0; t[0] < brick.tiles[0]; ++t[0]) {
        PlainIndex first;
        for (std::size_t a = 0; a < 3; ++a) first[a] = brick.first_cell[a] + t[a] * p.tile_cells;
        const PlainRange expected =
            closureByBruteForce(reference, brick.level, first, end(first, p.tile_cells),
                                brick.level + log2Of(p.tile_cells));
        const PlainRange stored = brick.tileRangeOfCell(first, p.tile_cells);
        if (!(stored == expected)) {
          ADD_FAILURE() << name << ": range of tile " << textOf(t) << " is " << stored.min << " .. "
                        << stored.max << ", not " << expected.min << " .. " << expected.max
                        << " (codec " << brick.parts[1].codec << ")";
          return false;
        }
      }
  return true;
}

// The project's own reader says the same as the plain one.
bool readersAgree(const Pyramid& pyramid, const PlainBrick& brick) {
  const Index3 index = indexOf(brick);
  const BrickSamples samples = pyramid.samples(brick.level, index);
  bool same =
      plain(samples.box.first) == brick.first_sample && plain(samples.box.count) == brick.count;
  visitVoxelType(pyramid.spec().voxel_type, [&](auto tag) {
    const auto* data = samples.data<typename decltype(tag)::Type>();
    for (std::size_t i = 0; i < brick.samples.size(); ++i)
      same = same && static_cast<float>(data[i]) == brick.samples[i];
  });
  std::vector<ValueRange> ranges;
  pyramid.tileRanges(brick.level, index, ranges);
  same = same && ranges.size() == brick.tile_ranges.size();
  for (std::size_t i = 0; same && i < ranges.size(); ++i)
    same = PlainRange{ranges[i].min, ranges[i].max} == brick.tile_ranges[i];
  const ValueRange range = pyramid.brickRange(brick.level, index);
  same = same && PlainRange{range.min, range.max} == brick.range;
  if (brick.level == 0) {
    std::vector<std::uint8_t> codes;
    pyramid.parts().curvature(index, codes);
    same = same && codes == brick.codes;
  }
  return same && !verifyBrick(pyramid, brick.level, index).has_value();
}

struct FormatCase {
  Index3 dims{0};
  std::int64_t brick_cells = 4, tile_cells = 2;
  format::Filter filter = format::Filter::kAverage;
  format::Codec codec = format::Codec::kStored;
  int kind = 0;
  bool curvature = true;
};

constexpr format::Codec kCodecs[] = {format::Codec::kStored, format::Codec::kLz4,
                                     format::Codec::kZstd};

template <typename T>
void checkCase(const TemporaryFolder& folder, Random& random, const FormatCase& c) {
  std::ostringstream name;
  name << voxelTypeName(voxelTypeOf<T>()) << " " << textOf(plain(c.dims)) << " voxels, bricks "
       << c.brick_cells << ", tiles " << c.tile_cells << ", filter " << static_cast<int>(c.filter)
       << ", kind " << c.kind << ", codec " << codecName(c.codec);
  SCOPED_TRACE(name.str());
  ArraySource<T> source(c.dims, randomVoxels<T>(random, c.dims, c.kind));
  BuildOptions options;
  options.brick_cells = c.brick_cells;
  options.tile_cells = c.tile_cells;
  options.filter = c.filter;
  options.codec = c.codec;
  options.with_curvature = c.curvature;
  const std::string path = folder.file("case.isb");
  const BuildReport report = buildPyramid(source, path, options);

  PlainPyramid p;
  ASSERT_NO_THROW(p = readPlainPyramid(path));
  ASSERT_EQ(p.file_bytes, report.file_bytes);
  ASSERT_EQ(p.dims, plain(c.dims));
  ASSERT_EQ(p.voxel_type, static_cast<std::uint32_t>(voxelTypeOf<T>()));
  ASSERT_EQ(p.filter, static_cast<std::uint32_t>(c.filter));
  ASSERT_EQ(p.brick_cells, c.brick_cells);
  ASSERT_EQ(p.tile_cells, c.tile_cells);
  ASSERT_EQ(p.has_curvature, c.curvature);
  const auto [least, greatest] =
      std::minmax_element(source.values().begin(), source.values().end());
  ASSERT_EQ(p.value_min, static_cast<double>(*least));
  ASSERT_EQ(p.value_max, static_cast<double>(*greatest));

  const ReferencePyramid reference =
      buildReferencePyramid<T>(c.dims, source.values(),
                               c.filter == format::Filter::kAverage ? ReferenceFilter::kAverage
                                                                    : ReferenceFilter::kSubsample);
  ASSERT_EQ(p.levels.size(), reference.levels.size());
  const Pyramid pyramid(path);
  for (const PlainBrick& brick : p.bricks) {
    const std::string brick_name =
        "brick " + textOf(brick.index) + " of level " + std::to_string(brick.level);
    if (!brickIsRight(p, brick, reference, brick_name)) return;
    if (!readersAgree(pyramid, brick)) {
      ADD_FAILURE() << "the two readers differ in " << brick_name;
      return;
    }
  }
}

void checkCaseOfType(const TemporaryFolder& folder, Random& random, int type, const FormatCase& c) {
  visitVoxelType(static_cast<VoxelType>(type),
                 [&](auto tag) { checkCase<typename decltype(tag)::Type>(folder, random, c); });
}

constexpr std::int64_t kBrickAndTileCells[][2] = {{4, 2}, {4, 4},  {8, 2},  {8, 4},
                                                  {8, 8}, {16, 4}, {32, 8}, {64, 4}};

FormatCase randomCase(Random& random, const Index3& dims) {
  FormatCase c;
  c.dims = dims;
  const auto& cut = kBrickAndTileCells[randomInt(random, 0, 7)];
  c.brick_cells = cut[0];
  c.tile_cells = cut[1];
  c.filter = randomInt(random, 0, 2) == 0 ? format::Filter::kSubsample : format::Filter::kAverage;
  c.codec = kCodecs[randomInt(random, 0, 2)];
  c.kind = static_cast<int>(randomInt(random, 0, 2));
  c.curvature = randomInt(random, 0, 3) > 0;
  return c;
}

TEST(Format, EveryValueReadsBackAllSmallDimensions) {
  const TemporaryFolder folder;
  Random random(1);
  int type = 0;
  const int step = std::max(1, 5 / repetitions(5));  // of rounds: each n has some of them
  for (std::int64_t n = 2; n <= 21; ++n)
    for (int round = static_cast<int>(n) % step; round < 5 && !HasFailure();
         round += step, ++type) {
      // Once as a cube, else with two other axes at random: thin last cells of every kind.
      const Index3 dims =
          round == 0   ? Index3(n)
          : round == 1 ? Index3(n, randomInt(random, 2, 21), randomInt(random, 2, 21))
          : round == 2 ? Index3(randomInt(random, 2, 21), n, randomInt(random, 2, 21))
                       : Index3(randomInt(random, 2, 21), randomInt(random, 2, 21), n);
      for (const auto filter : {format::Filter::kAverage, format::Filter::kSubsample}) {
        FormatCase c = randomCase(random, dims);
        c.filter = filter;
        checkCaseOfType(folder, random, type % 5, c);
      }
    }
}

TEST(Format, EveryValueReadsBackTwoByTwoByTwo) {
  const TemporaryFolder folder;
  Random random(2);
  for (int type = 0; type < 5; ++type)
    for (const auto& cut : kBrickAndTileCells) {
      FormatCase c;
      c.dims = Index3(2);
      c.brick_cells = cut[0];
      c.tile_cells = cut[1];
      checkCaseOfType(folder, random, type, c);
    }
}

TEST(Format, EveryValueReadsBackPowersPrimesAndTheirNeighbours) {
  const TemporaryFolder folder;
  Random random(3);
  int type = 0;
  for (const std::int64_t n : {31, 32, 33, 37, 63, 64, 65, 66, 67, 127, 129, 131}) {
    for (int axis = 0; axis < 3 && !HasFailure(); ++axis, ++type) {
      Index3 dims(randomInt(random, 2, 12), randomInt(random, 2, 12), randomInt(random, 2, 12));
      dims[axis] = n;
      checkCaseOfType(folder, random, type % 5, randomCase(random, dims));
    }
  }
}

// 65 voxels are one brick of 64 cells; 66 give seven more bricks, one cell thin. The usual sizes.
TEST(Format, EveryValueReadsBackUsualBricks) {
  const TemporaryFolder folder;
  Random random(4);
  FormatCase c;
  c.brick_cells = 64;
  c.tile_cells = 4;
  c.dims = Index3(66, 65, 67);
  for (const format::Codec codec : kCodecs) {
    c.codec = codec;
    c.kind = codec == format::Codec::kStored ? 0 : 1;  // noise is never packed
    checkCase<std::uint16_t>(folder, random, c);
  }
}

TEST(Format, FilesAreTheSameForAnyNumberOfThreads) {
  const TemporaryFolder folder;
  Random random(5);
  const Index3 dims(45, 38, 51);
  const auto voxels = randomVoxels<std::uint16_t>(random, dims, 1);
  std::set<std::uintmax_t> sizes;
  for (const format::Codec codec : kCodecs) {
    std::vector<std::uint8_t> first;
    for (const std::size_t threads : {1, 2, 4, 4}) {
      const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
      ArraySource<std::uint16_t> source(dims, voxels);
      BuildOptions options;
      options.brick_cells = 16;
      options.codec = codec;
      const std::string path = folder.file("threads.isb");
      buildPyramid(source, path, options);
      const auto bytes = readWholeFile(path);
      if (first.empty()) first = bytes;
      EXPECT_TRUE(bytes == first) << threads << " threads give another file";
    }
    sizes.insert(first.size());
  }
  EXPECT_EQ(sizes.size(), 3u) << "the codecs make no difference";
}

// a + b x + c y + d z in voxels, with steps that every type holds exactly.
template <typename T>
void checkLinear(const TemporaryFolder& folder, const Index3& dims, double a,
                 const glm::dvec3& slope, format::Filter filter) {
  const auto value = [&](const Index3& at) {
    return a + slope.x * static_cast<double>(at.x) + slope.y * static_cast<double>(at.y) +
           slope.z * static_cast<double>(at.z);
  };
  ArraySource<T> source(dims, arrayOfField<T>(dims, value));
  BuildOptions options;
  options.brick_cells = 8;
  options.filter = filter;
  const std::string path = folder.file("linear.isb");
  buildPyramid(source, path, options);
  const PlainPyramid p = readPlainPyramid(path);
  for (const PlainBrick& brick : p.bricks) {
    PlainIndex s;
    for (s[2] = 0; s[2] < brick.count[2]; ++s[2])
      for (s[1] = 0; s[1] < brick.count[1]; ++s[1])
        for (s[0] = 0; s[0] < brick.count[0]; ++s[0]) {
          PlainIndex sample;
          Index3 position;
          for (int axis = 0; axis < 3; ++axis) {
            const auto i = static_cast<std::size_t>(axis);
            sample[i] = brick.first_sample[i] + s[i];
            position[axis] = std::min(sample[i] << brick.level, dims[axis] - 1);
          }
          ASSERT_EQ(static_cast<double>(brick.sampleAt(sample)), value(position))
              << voxelTypeName(voxelTypeOf<T>()) << " level " << brick.level << " sample "
              << textOf(sample) << " of " << textOf(plain(dims));
        }
  }
}

TEST(Format, LinearFieldsAreExactOnAllLevels) {
  const TemporaryFolder folder;
  for (const Index3& dims : {Index3(2), Index3(3, 5, 9), Index3(4, 8, 16), Index3(17, 33, 6),
                             Index3(18, 34, 7), Index3(23, 19, 31), Index3(40, 3, 2)})
    for (const auto filter : {format::Filter::kAverage, format::Filter::kSubsample}) {
      checkLinear<std::uint8_t>(folder, dims, 3, {2, 1, 3}, filter);
      checkLinear<std::int8_t>(folder, dims, -60, {1, 2, -1}, filter);
      checkLinear<std::uint16_t>(folder, dims, 40000, {301, -402, 205}, filter);
      checkLinear<std::int16_t>(folder, dims, -77, {-301, 402, 205}, filter);
      checkLinear<float>(folder, dims, -1.75, {0.25, 1024.5, -3.125}, filter);
    }
}

TEST(Format, ConstantVolumesStoreNoSamples) {
  const TemporaryFolder folder;
  const Index3 dims(35, 22, 19);
  for (int type = 0; type < 5; ++type)
    visitVoxelType(static_cast<VoxelType>(type), [&](auto tag) {
      using T = typename decltype(tag)::Type;
      const T value = static_cast<T>(std::is_signed_v<T> ? -100 : 200);
      ArraySource<T> source(dims,
                            std::vector<T>(static_cast<std::size_t>(elementCount(dims)), value));
      BuildOptions options;
      options.brick_cells = 8;
      const std::string path = folder.file("constant.isb");
      buildPyramid(source, path, options);
      const PlainPyramid p = readPlainPyramid(path);
      for (const PlainBrick& brick : p.bricks) {
        for (const PlainPart& part : brick.parts) EXPECT_EQ(part.stored_bytes, 0u);
        for (const float sample : brick.samples) ASSERT_EQ(sample, static_cast<float>(value));
      }
      // Header, histogram, tables and provenance, each aligned to 64 bytes.
      EXPECT_LE(p.file_bytes, 512 + 8 + 56 * p.levels.size() + 96 * p.bricks.size() +
                                  p.provenance.size() + 4 * 64);
      EXPECT_EQ(Pyramid(path).sums().bytes.samples_level0, 0u);
    });
}

// Plane ramps with some noise: what volumes are like. Every kind of part is packed, in bricks of
// the usual size, and info's count of codecs is that of the plain reader.
TEST(Format, SmoothVolumesArePackedInAllParts) {
  const TemporaryFolder folder;
  const Index3 dims(90, 70, 66);
  for (const format::Codec codec : {format::Codec::kLz4, format::Codec::kZstd})
    for (int type = 0; type < 5; ++type)
      visitVoxelType(static_cast<VoxelType>(type), [&](auto tag) {
        using T = typename decltype(tag)::Type;
        Random random(10);
        const auto value = [&](const Index3& at) {
          const double wave = std::sin(0.1 * static_cast<double>(at.x + at.y)) +
                              std::cos(0.13 * static_cast<double>(at.z - at.y));
          return std::floor(60 + 25 * wave) + (randomBelow(random, 8) == 0 ? 1 : 0);
        };
        ArraySource<T> source(dims, arrayOfField<T>(dims, value));
        BuildOptions options;
        options.codec = codec;
        const std::string path = folder.file("smooth.isb");
        buildPyramid(source, path, options);
        const PlainPyramid p = readPlainPyramid(path);
        const Pyramid pyramid(path);
        PyramidCodecs counts;
        for (const PlainBrick& brick : p.bricks) {
          ASSERT_TRUE(readersAgree(pyramid, brick)) << "brick " << textOf(brick.index);
          ++counts.samples[brick.parts[0].codec];
          ++counts.ranges[brick.parts[1].codec];
          ++counts.curvature[brick.parts[2].codec];
        }
        const auto [bytes, codecs] = pyramid.sums();
        EXPECT_EQ(counts.samples, codecs.samples);
        EXPECT_EQ(counts.ranges, codecs.ranges);
        EXPECT_EQ(counts.curvature, codecs.curvature);
        EXPECT_GT(counts.samples[static_cast<std::size_t>(codec)], 2u);
        EXPECT_GT(counts.ranges[static_cast<std::size_t>(codec)], 0u);
        EXPECT_LT(bytes.aprons_level0, bytes.samples_level0 / 4);
        EXPECT_GT(bytes.aprons_level0, bytes.samples_level0 / 50);
        // The differences of the format, not only bytes that nothing was done to.
        const PlainPart& part = p.bricks.front().parts[0];
        ASSERT_EQ(part.codec, static_cast<std::uint32_t>(codec));
        EXPECT_EQ(readWholeFile(path)[part.offset + 2] & 1, 1);
      });
}

// A constant brick beside others must not spoil the reader's idea of its tiles.
TEST(Format, ConstantRegionsBesideOthers) {
  const TemporaryFolder folder;
  Random random(6);
  for (int round = 0; round < 20 && !HasFailure(); ++round) {
    FormatCase c = randomCase(random, Index3(randomInt(random, 9, 40), randomInt(random, 2, 20),
                                             randomInt(random, 2, 20)));
    c.brick_cells = round % 2 == 0 ? 4 : 8;
    c.tile_cells = round % 3 == 0 ? 4 : 2;
    c.kind = 2;
    checkCaseOfType(folder, random, round % 5, c);
  }
}

TEST(Format, NotFiniteVoxelsAreRefusedWithThePositionOfTheFirst) {
  const TemporaryFolder folder;
  const Index3 dims(7, 5, 40);
  const float infinity = std::numeric_limits<float>::infinity();
  for (const float bad : {std::nanf(""), infinity, -infinity})
    for (const Index3& at :
         {Index3(0, 0, 0), Index3(6, 4, 39), Index3(3, 2, 16), Index3(1, 4, 15)}) {
      std::vector<float> voxels(static_cast<std::size_t>(elementCount(dims)), 1.5f);
      voxels[static_cast<std::size_t>(linearIndex(at, dims))] = bad;
      voxels.back() = infinity;  // a later one must not be the one that is named
      ArraySource<float> source(dims, voxels);
      const std::string message = messageOfBuild(source, folder.file("nan.isb"), {});
      const std::string position = textOf(plain(at));
      EXPECT_NE(message.find(position), std::string::npos) << message << " lacks " << position;
      EXPECT_NE(message.find("memory"), std::string::npos) << message << " lacks the source";
      EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
    }
}

TEST(Format, NotFiniteVoxelsAreReplaced) {
  const TemporaryFolder folder;
  Random random(7);
  const Index3 dims(9, 6, 20);
  auto voxels = randomVoxels<float>(random, dims, 0);
  auto expected = voxels;
  const float infinity = std::numeric_limits<float>::infinity();
  const float bad[3] = {std::nanf(""), infinity, -infinity};
  for (std::size_t i = 5; i < voxels.size(); i += 37) {
    voxels[i] = bad[i % 3];
    expected[i] = -12.5f;
  }
  ArraySource<float> source(dims, voxels);
  BuildOptions options;
  options.brick_cells = 8;
  options.nan_as = -12.5f;
  const std::string path = folder.file("replaced.isb");
  const BuildReport report = buildPyramid(source, path, options);
  const auto replaced = static_cast<std::uint64_t>((voxels.size() - 5 + 36) / 37);
  EXPECT_EQ(report.replaced_voxels, replaced);
  const PlainPyramid p = readPlainPyramid(path);
  const ReferencePyramid reference = buildReferencePyramid<float>(dims, expected);
  for (const PlainBrick& brick : p.bricks) ASSERT_TRUE(brickIsRight(p, brick, reference, "brick"));
  const auto notes = nlohmann::json::parse(p.provenance).at("notes");
  ASSERT_EQ(notes.size(), 1u);
  EXPECT_NE(notes[0].get<std::string>().find("became -12.5"), std::string::npos);
}

// A replacement that is itself not finite would make a file that no reader accepts.
TEST(Format, ReplacementThatIsNotFiniteIsRefused) {
  const TemporaryFolder folder;
  for (const float bad : {std::nanf(""), std::numeric_limits<float>::infinity()}) {
    std::vector<float> voxels(64, 1.0f);
    voxels[10] = std::nanf("");
    ArraySource<float> source(Index3(4), voxels);
    BuildOptions options;
    options.nan_as = bad;
    EXPECT_NE(messageOfBuild(source, folder.file("bad.isb"), options), "")
        << "nan_as = " << bad << " was accepted";
    EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
  }
}

TEST(Format, HeaderHoldsGeometryAndProvenanceItsKeys) {
  const TemporaryFolder folder;
  Random random(8);
  ArraySource<std::int16_t> source(Index3(6, 7, 8),
                                   randomVoxels<std::int16_t>(random, Index3(6, 7, 8), 0));
  GridGeometry& geometry = source.editInfo().geometry;
  geometry.spacing = {0.5, 0.25, 3.0};
  geometry.origin = {-10.125, 1e6, 3e-7};
  geometry.direction =
      glm::dmat3(glm::dvec3(0, -1, 0), glm::dvec3(0.6, 0, 0.8), glm::dvec3(0.8, 0, -0.6));
  source.editInfo().source = "folder \"with\"\xff\xfe.nrrd";  // not UTF-8
  source.editInfo().notes = {"slope 2", "intercept -1024"};
  BuildOptions options;
  options.tool_version = "9.8.7";
  options.curvature_epsilon = 0.125;
  options.filter = format::Filter::kSubsample;
  const std::string path = folder.file("header.isb");
  buildPyramid(source, path, options);
  const PlainPyramid p = readPlainPyramid(path);
  const Pyramid pyramid(path);
  for (int axis = 0; axis < 3; ++axis) {
    const auto a = static_cast<std::size_t>(axis);
    EXPECT_EQ(p.spacing[a], geometry.spacing[axis]);
    EXPECT_EQ(p.origin[a], geometry.origin[axis]);
    for (int row = 0; row < 3; ++row)
      EXPECT_EQ(p.direction[3 * a + static_cast<std::size_t>(row)], geometry.direction[axis][row]);
  }
  EXPECT_EQ(pyramid.spec().geometry.direction, geometry.direction);
  EXPECT_EQ(p.curvature_epsilon, 0.125);
  EXPECT_EQ(pyramid.spec().curvature_epsilon, 0.125);
  EXPECT_EQ(pyramid.provenance(), p.provenance);
  const auto json = nlohmann::json::parse(p.provenance);
  std::set<std::string> keys;
  for (const auto& [key, value] : json.items()) keys.insert(key);
  EXPECT_EQ(keys,
            (std::set<std::string>{"tool", "source", "format", "filter", "identity", "notes"}));
  EXPECT_EQ(json.at("tool"), "isobrick 9.8.7");
  EXPECT_EQ(json.at("format"), "test");
  EXPECT_EQ(json.at("filter"), "subsample");
  EXPECT_EQ(json.at("notes"), (nlohmann::json{"slope 2", "intercept -1024"}));
}

// The tests' own reader must be able to fail: it refuses what FORMAT.md section 12 forbids.
TEST(Format, PlainReaderRefusesDamage) {
  const TemporaryFolder folder;
  Random random(9);
  ArraySource<std::uint8_t> source(Index3(9), randomVoxels<std::uint8_t>(random, Index3(9), 0));
  BuildOptions options;
  options.brick_cells = 4;
  const std::string path = folder.file("good.isb");
  buildPyramid(source, path, options);
  const auto good = readWholeFile(path);
  const PlainPyramid p = readPlainPyramid(path);
  std::size_t covered = 0;
  for (const bool c : p.covered) covered += c ? 1 : 0;
  EXPECT_GT(covered, good.size() / 2);
  for (int round = 0; round < 200; ++round) {
    auto bytes = good;
    bytes[static_cast<std::size_t>(
        randomInt(random, 0, static_cast<std::int64_t>(good.size()) - 1))] ^=
        static_cast<std::uint8_t>(1 << randomInt(random, 0, 7));
    const std::string bad = folder.file("bad.isb");
    FILE* file = std::fopen(bad.c_str(), "wb");
    ASSERT_NE(file, nullptr);
    ASSERT_EQ(std::fwrite(bytes.data(), 1, bytes.size(), file), bytes.size());
    std::fclose(file);
    EXPECT_THROW(readPlainPyramid(bad), std::runtime_error);
  }
}

}  // namespace
}  // namespace isobrick::test
