// The curvature bound: the code that never goes below, and what the builder stores against the
// samples that it promises to bound, read by the plain reader and evaluated in double precision.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/storage/deviation_code.h"
#include "tests/support/array_source.h"
#include "tests/support/plain_reader.h"
#include "tests/support/random_numbers.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/trilinear_cell.h"

namespace isobrick::test {
namespace {

// ---- the code ----

TEST(DeviationCode, IsWhatTheFormatSays) {
  for (int code = 0; code < 256; ++code)
    EXPECT_EQ(static_cast<double>(DeviationCode::decode(static_cast<std::uint8_t>(code))),
              plainDeviationOfCode(static_cast<std::uint8_t>(code)))
        << code;
}

TEST(DeviationCode, NeverGoesBelowAndIsTheSmallestThatDoesNot) {
  const auto check = [](float distance) {
    const std::uint8_t code = DeviationCode::encodeUp(distance);
    ASSERT_GE(DeviationCode::decode(code), distance);
    ASSERT_TRUE(code <= DeviationCode::kMost || code == 255);
    if (code == 255) {
      ASSERT_GT(distance, 8);
    } else if (code > 0) {
      ASSERT_LT(DeviationCode::decode(static_cast<std::uint8_t>(code - 1)), distance);
    }
  };
  Random random(4);
  for (int round = 0; round < 300000; ++round)
    check(static_cast<float>(std::exp2(randomReal(random, -20, 6))));
  for (int code = 1; code <= DeviationCode::kMost; ++code) {
    const float distance = DeviationCode::decode(static_cast<std::uint8_t>(code));
    EXPECT_EQ(DeviationCode::encodeUp(distance), code);
    check(std::nextafter(distance, 1e30f));
    check(std::nextafter(distance, 0.0f));
  }
  check(std::numeric_limits<float>::denorm_min());
  check(std::numeric_limits<float>::infinity());
  EXPECT_EQ(DeviationCode::encodeUp(0), 0);
}

// What is not a number comes from an overflow: it must not become "flat".
TEST(DeviationCode, NotANumberIsNotFlat) {
  EXPECT_EQ(DeviationCode::encodeUp(std::numeric_limits<float>::quiet_NaN()), 255);
}

TEST(DeviationCode, BoundIsLinearBetweenTheMiddles) {
  Random random(5);
  for (int round = 0; round < 100000; ++round) {
    std::uint8_t codes[8];
    for (std::uint8_t& code : codes)
      code = static_cast<std::uint8_t>(random() % (round % 10 == 0 ? 256 : 60));
    const auto low = static_cast<float>(randomReal(random, -1000, 1000));
    const auto high = round % 50 == 0 ? low : low + static_cast<float>(randomReal(random, 0, 500));
    const auto value = static_cast<float>(randomReal(random, -1200, 1700));
    const double expected = plainDeviationBound(codes, {low, high}, static_cast<double>(value));
    const auto bound = static_cast<double>(deviationBound(codes, {low, high}, value));
    if (std::isinf(expected)) {
      EXPECT_EQ(bound, expected);
    } else {
      EXPECT_NEAR(bound, expected, 1e-6 * expected);
    }
  }
}

// ---- what is stored ----

using Field = std::function<double(const glm::dvec3& voxel)>;

Field whiteNoise(double low, double high) {
  return [random = Random(6), low, high](const glm::dvec3&) mutable {
    return randomReal(random, low, high);
  };
}

Field smoothWaves(double amplitude, double offset) {
  return [=](const glm::dvec3& p) {
    const double wave = std::sin(0.11 * p.x + 0.07 * p.y) + std::cos(0.09 * p.y - 0.13 * p.z) +
                        std::sin(0.15 * p.z + 0.05 * p.x + 1) * std::cos(0.08 * p.y);
    return offset + amplitude * wave / 3;
  };
}

Field ball(const glm::dvec3& center, double radius) {
  return [=](const glm::dvec3& p) { return radius - glm::length(p - center); };
}

struct BoundedVolume {
  PlainPyramid pyramid;
  BuildReport report = {};

  // By the index of the sample in its level.
  double sample(int level, const PlainIndex& at) const {
    PlainIndex brick{};
    for (std::size_t a = 0; a < 3; ++a)
      brick[a] = std::min(at[a] / pyramid.brick_cells,
                          pyramid.levels[static_cast<std::size_t>(level)].bricks[a] - 1);
    return static_cast<double>(pyramid.brickAt(level, brick).sampleAt(at));
  }
  TrilinearCell cell(int level, const PlainIndex& at) const {
    TrilinearCell result;
    for (std::int64_t i = 0; i < 8; ++i)
      result.corners[static_cast<std::size_t>(i)] =
          sample(level, {at[0] + (i & 1), at[1] + (i >> 1 & 1), at[2] + (i >> 2)});
    return result;
  }
};

BoundedVolume makeVolume(const Index3& dims, VoxelType type, const Field& field,
                         std::int64_t brick_cells = 16, std::int64_t tile_cells = 4) {
  const TemporaryFolder folder;
  BuildOptions options;
  options.brick_cells = brick_cells;
  options.tile_cells = tile_cells;
  const std::string path = folder.file("volume.isb");
  BuildReport report;
  visitVoxelType(type, [&](auto tag) {
    using T = typename decltype(tag)::Type;
    // The field is copied because those of noise have a state.
    ArraySource<T> source(
        dims, arrayOfField<T>(dims, [field](const Index3& at) { return field(glm::dvec3(at)); }));
    report = buildPyramid(source, path, options);
  });
  return {readPlainPyramid(path), report};
}

struct Block {
  PlainIndex first{}, end{};  // cells of level 0
  PlainRange range;
  const std::uint8_t* codes = nullptr;
  bool is_stored = false;  // else they are 255, since there is nothing to gain in the brick
};

void forAllBlocks(const BoundedVolume& volume, const std::function<void(const Block&)>& f) {
  const std::int64_t edge = plainBlockCells(volume.pyramid);
  for (const PlainBrick& brick : volume.pyramid.bricks) {
    if (brick.level > 0) continue;
    const std::uint8_t* codes = brick.codes.data();
    PlainIndex b;
    for (b[2] = 0; b[2] < brick.blocks[2]; ++b[2])
      for (b[1] = 0; b[1] < brick.blocks[1]; ++b[1])
        for (b[0] = 0; b[0] < brick.blocks[0]; ++b[0], codes += 8) {
          Block block;
          for (std::size_t a = 0; a < 3; ++a) {
            block.first[a] = brick.first_cell[a] + edge * b[a];
            block.end[a] = std::min(block.first[a] + edge, brick.first_cell[a] + brick.cells[a]);
          }
          block.range = plainBlockRange(volume.pyramid, brick, b);
          block.codes = codes;
          block.is_stored = brick.parts[2].codec != 2;
          f(block);
        }
  }
}

// The cells of level 1 in the block, with their voxels along each axis.
void forCellsOf(const Block& block,
                const std::function<void(const PlainIndex& cell, const PlainIndex& voxels)>& f) {
  PlainIndex c, n;
  for (c[2] = block.first[2] / 2; 2 * c[2] < block.end[2]; ++c[2])
    for (c[1] = block.first[1] / 2; 2 * c[1] < block.end[1]; ++c[1])
      for (c[0] = block.first[0] / 2; 2 * c[0] < block.end[0]; ++c[0]) {
        for (std::size_t a = 0; a < 3; ++a)
          n[a] = std::min<std::int64_t>(2, block.end[a] - 2 * c[a]);
        f(c, n);
      }
}

// The length of the gradient of level 1 in the middle of the cell, in values per voxel.
double slopeOf(const TrilinearCell& coarse, const PlainIndex& voxels) {
  const glm::dvec3 g = coarse.gradient(glm::dvec3(0.5));
  return glm::length(g / glm::dvec3(voxels[0], voxels[1], voxels[2]));
}

struct Sample {
  double value = 0, deviation = 0;
};

// The samples of section 8 that count; those whose slope is at the threshold are left to chance.
std::vector<Sample> samplesOf(const BoundedVolume& volume, const Block& block) {
  std::vector<Sample> samples;
  const double width = static_cast<double>(block.range.max) - static_cast<double>(block.range.min);
  forCellsOf(block, [&](const PlainIndex& cell, const PlainIndex& voxels) {
    const TrilinearCell coarse = volume.cell(1, cell);
    const double slope = slopeOf(coarse, voxels);
    if (!(slope > 0 && slope >= volume.pyramid.curvature_epsilon * width)) return;
    PlainIndex v;
    for (v[2] = 0; v[2] < voxels[2]; ++v[2])
      for (v[1] = 0; v[1] < voxels[1]; ++v[1])
        for (v[0] = 0; v[0] < voxels[0]; ++v[0]) {
          const glm::dvec3 at(0.5 * static_cast<double>(v[0]), 0.5 * static_cast<double>(v[1]),
                              0.5 * static_cast<double>(v[2]));
          const double value =
              volume.sample(0, {2 * cell[0] + v[0], 2 * cell[1] + v[1], 2 * cell[2] + v[2]});
          samples.push_back({value, std::abs(coarse.value(at) - value) / slope});
        }
  });
  return samples;
}

// The part of the range that the sample is in, or -1 if rounding may decide.
int partOf(const Block& block, const Sample& sample) {
  const double width = static_cast<double>(block.range.max) - static_cast<double>(block.range.min);
  const double at = 8 * (sample.value - static_cast<double>(block.range.min)) / width;
  if (at > 1e-3 && at < 7.9 && std::abs(at - std::round(at)) < 1e-3) return -1;
  return std::min(static_cast<int>(at), 7);
}

struct Case {
  const char* name;
  Index3 dims;
  VoxelType type;
  Field field;
  std::int64_t brick_cells, tile_cells;
};
std::vector<Case> cases() {
  return {
      {"noise uint8", Index3(40), VoxelType::kUint8, whiteNoise(0, 256), 16, 4},
      {"noise uint16, thin ends", Index3(36, 35, 34), VoxelType::kUint16, whiteNoise(0, 65536), 16,
       4},
      {"noise int8, bricks of 4", Index3(20, 23, 22), VoxelType::kInt8, whiteNoise(-128, 128), 4,
       2},
      {"waves uint16", Index3(50, 49, 48), VoxelType::kUint16, smoothWaves(30000, 32000), 64, 4},
      {"waves float32", Index3(41, 40, 37), VoxelType::kFloat32, smoothWaves(1, 0), 16, 16},
      {"waves far from 0", Index3(33, 34, 35), VoxelType::kFloat32, smoothWaves(1, 1000), 16, 8},
      {"waves in blocks of 16", Index3(129, 30, 31), VoxelType::kInt16, smoothWaves(900, 0), 64, 4},
      {"ball", Index3(43), VoxelType::kFloat32, ball(glm::dvec3(20, 21, 22), 15), 32, 2},
  };
}

// Three quarters of the samples in each part of the range are within the code's distance, and not
// within the next smaller one's.
TEST(CurvatureBound, IsTheSmallestCodeThatThreeQuartersOfTheSamplesKeep) {
  std::int64_t parts = 0, empty = 0, samples = 0;
  for (const Case& c : cases()) {
    const BoundedVolume volume = makeVolume(c.dims, c.type, c.field, c.brick_cells, c.tile_cells);
    forAllBlocks(volume, [&](const Block& block) {
      std::vector<double> within[8];
      bool is_certain[8] = {true, true, true, true, true, true, true, true};
      for (const Sample& sample : samplesOf(volume, block)) {
        const int part = partOf(block, sample);
        if (part < 0)
          std::fill_n(is_certain, 8, false);
        else
          within[part].push_back(sample.deviation);
        ++samples;
      }
      for (int part = 0; part < 8; ++part) {
        const std::vector<double>& all = within[part];
        if (all.empty() || !is_certain[part]) {
          ++empty;
          continue;
        }
        ++parts;
        const auto share = [&](double distance) {
          return static_cast<double>(std::count_if(all.begin(), all.end(),
                                                   [&](double d) { return d <= distance; })) /
                 static_cast<double>(all.size());
        };
        const std::uint8_t code = block.codes[part];
        if (!block.is_stored) {
          ASSERT_LT(share(0.5 * (1 - 1e-4)), 0.75) << c.name;
          continue;
        }
        ASSERT_GE(share(plainDeviationOfCode(code) * (1 + 1e-4) + 1e-6), 0.75) << c.name;
        if (code == 0) continue;
        const auto less = static_cast<std::uint8_t>(code == 255 ? DeviationCode::kMost : code - 1);
        ASSERT_LT(share(plainDeviationOfCode(less) * (1 - 1e-4) - 1e-6), 0.75) << c.name;
      }
    });
  }
  std::printf("  %lld parts of ranges, %lld others, %lld samples\n", static_cast<long long>(parts),
              static_cast<long long>(empty), static_cast<long long>(samples));
  EXPECT_GT(parts, 5000);
  EXPECT_GT(samples, 300000);
}

// A part of the range without samples takes the greater code of the parts beside it that have some.
TEST(CurvatureBound, PartsWithoutSamplesTakeTheirNeighbours) {
  const BoundedVolume volume = makeVolume(Index3(17), VoxelType::kUint8, [](const glm::dvec3& p) {
    return p.x < 4 ? 2 * p.x : 200 + p.x;
  });
  int filled = 0;
  forAllBlocks(volume, [&](const Block& block) {
    bool has_samples[8] = {};
    for (const Sample& sample : samplesOf(volume, block))
      if (const int part = partOf(block, sample); part >= 0) has_samples[part] = true;
    for (int part = 1; part < 7; ++part) {
      if (has_samples[part]) continue;
      int low = part, high = part;
      while (low > 0 && !has_samples[low]) --low;
      while (high < 7 && !has_samples[high]) ++high;
      if (!has_samples[low] || !has_samples[high]) continue;
      EXPECT_EQ(block.codes[part], std::max(block.codes[low], block.codes[high]));
      ++filled;
    }
  });
  EXPECT_GT(filled, 10);
}

// Distances do not depend on the unit of the values, so neither may the bound: float volumes range
// from densities of 1e-27 to temperatures of 1e8 and beyond.
TEST(CurvatureBound, DoesNotDependOnTheUnitOfTheValues) {
  std::vector<std::uint8_t> codes_of_one;
  for (const double unit :
       {1.0, 0x1p-20, 0x1p-40, 0x1p-60, 0x1p-100, 0x1p20, 0x1p40, 0x1p60, 0x1p100, 0x1p124}) {
    const Field noise = whiteNoise(-1, 1);
    const BoundedVolume volume =
        makeVolume(Index3(21, 18, 19), VoxelType::kFloat32, [&](const glm::dvec3& p) {
          return unit * static_cast<double>(static_cast<float>(noise(p)));
        });
    std::vector<std::uint8_t> codes;
    for (const PlainBrick& brick : volume.pyramid.bricks)
      codes.insert(codes.end(), brick.codes.begin(), brick.codes.end());
    if (codes_of_one.empty()) codes_of_one = codes;
    EXPECT_TRUE(codes == codes_of_one) << "unit 2^" << std::log2(unit) << " gives other codes";
  }
}

TEST(CurvatureBound, RangesThatOverflowAreNotFlat) {
  const BoundedVolume volume = makeVolume(Index3(9), VoxelType::kFloat32, [](const glm::dvec3& p) {
    return (static_cast<int>(p.x) % 2 == 0 ? 1 : -1) * 3.4e38;
  });
  forAllBlocks(volume, [](const Block& block) {
    for (int part = 0; part < 8; ++part) EXPECT_EQ(block.codes[part], 255);
    EXPECT_FALSE(block.is_stored);
  });
}

TEST(CurvatureBound, LinearFieldsAndVolumesOfOneLevelAreFlat) {
  const auto linear = [](const glm::dvec3& p) { return 100 + 3 * p.x + 5 * p.y + 7 * p.z; };
  for (const Index3& dims : {Index3(17, 18, 19), Index3(2)}) {
    const BoundedVolume volume = makeVolume(dims, VoxelType::kUint16, linear);
    forAllBlocks(volume, [](const Block& block) {
      for (int part = 0; part < 8; ++part) ASSERT_LE(block.codes[part], 1);  // of rounding
    });
  }
}

// A brick of which no part is within half a voxel stores nothing, and the others all of theirs.
TEST(CurvatureBound, IsNotStoredWhereThereIsNothingToGain) {
  const Field noise = whiteNoise(0, 256);
  const BoundedVolume all = makeVolume(Index3(40), VoxelType::kUint8, noise);
  EXPECT_FALSE(all.report.has_curvature);
  forAllBlocks(all, [](const Block& block) { EXPECT_FALSE(block.is_stored); });

  const BoundedVolume half =
      makeVolume(Index3(65, 33, 33), VoxelType::kUint8,
                 [&](const glm::dvec3& p) { return p.x > 32 ? noise(p) : 2 * p.x + p.y; });
  EXPECT_TRUE(half.report.has_curvature);
  int bricks = 0, stored = 0;
  for (const PlainBrick& brick : half.pyramid.bricks) {
    if (brick.level > 0) continue;
    ++bricks;
    stored += brick.parts[2].codec != 2;
    EXPECT_EQ(brick.parts[2].codec != 2, brick.first_cell[0] < 32) << brick.first_cell[0];
  }
  EXPECT_EQ(bricks, 16);
  EXPECT_EQ(stored, 8);
}

// What `--curvature-radius` says: a sphere is as flat as itself, and not twice as flat.
TEST(CurvatureBound, SpheresAreAsFlatAsTheirRadius) {
  for (const double radius : {8.0, 13.0, 21.0}) {
    const auto size = static_cast<std::int64_t>(2 * radius + 15);
    const glm::dvec3 center(0.5 * static_cast<double>(size) + 0.3);
    const BoundedVolume volume =
        makeVolume(Index3(size), VoxelType::kFloat32, ball(center, radius), 32, 4);
    const auto shareOfFlat = [&](double as_radius) {
      const double most = deviationOfSphere(1 / (2 * as_radius * as_radius));
      int crossed = 0, flat = 0;
      forAllBlocks(volume, [&](const Block& block) {
        if (!(block.range.min < 0 && block.range.max >= 0)) return;
        ++crossed;
        flat += plainDeviationBound(block.codes, block.range, 0) <= most;
      });
      EXPECT_GT(crossed, 15);
      return static_cast<double>(flat) / crossed;
    };
    EXPECT_GT(shareOfFlat(radius), 0.9) << radius;
    EXPECT_LT(shareOfFlat(2 * radius), 0.1) << radius;
  }
}

// The bound is an estimate where the fit saw no sample, but one to rely on.
TEST(CurvatureBound, HoldsForMostUnseenPoints) {
  Random random(8);
  for (const Case& c : cases()) {
    const BoundedVolume volume = makeVolume(c.dims, c.type, c.field, c.brick_cells, c.tile_cells);
    std::int64_t points = 0, above = 0;
    forAllBlocks(volume, [&](const Block& block) {
      const double width =
          static_cast<double>(block.range.max) - static_cast<double>(block.range.min);
      forCellsOf(block, [&](const PlainIndex& cell, const PlainIndex& voxels) {
        const TrilinearCell coarse = volume.cell(1, cell);
        const double slope = slopeOf(coarse, voxels);
        if (!(slope > 0 && slope >= volume.pyramid.curvature_epsilon * width)) return;
        const glm::dvec3 at(randomReal(random, 0, 1), randomReal(random, 0, 1),
                            randomReal(random, 0, 1));
        PlainIndex fine{};
        glm::dvec3 in_fine;
        for (int a = 0; a < 3; ++a) {
          const auto axis = static_cast<std::size_t>(a);
          const double place = at[a] * static_cast<double>(voxels[axis]);
          const auto whole = std::min(static_cast<std::int64_t>(place), voxels[axis] - 1);
          fine[axis] = 2 * cell[axis] + whole;
          in_fine[a] = place - static_cast<double>(whole);
        }
        const double value = volume.cell(0, fine).value(in_fine);
        ++points;
        above += std::abs(coarse.value(at) - value) / slope >
                 plainDeviationBound(block.codes, block.range, value);
      });
    });
    EXPECT_GT(points, 800) << c.name;
    EXPECT_LT(above * 100, points * 30) << c.name << ": " << above << " of " << points;
  }
}

}  // namespace
}  // namespace isobrick::test
