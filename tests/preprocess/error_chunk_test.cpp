// The stored error bounds against a slow reference, cell by cell and isovalue by isovalue.
#include "isobrick/preprocess/error_chunk.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "isobrick/storage/index_loop.h"
#include "tests/support/every_target.h"
#include "tests/support/random_numbers.h"
#include "tests/support/reference_error.h"
#include "tests/support/reference_pyramid.h"

namespace isobrick::test {
namespace {

// Smooth, with some noise and a step; half of them clipped, as a scanner's values are: there the
// greatest that a coarser field may be does not change from voxel to voxel.
std::vector<float> randomVoxels(Random& random, const Index3& dims) {
  const double a = randomReal(random, 0.1, 0.7), b = randomReal(random, 0.1, 0.7);
  const double noise = randomInt(random, 0, 1) == 0 ? 1 : 40;
  const double most = randomInt(random, 0, 1) == 0 ? 30 : 1000;
  std::vector<float> voxels;
  forEachIndex({Index3(0), dims}, [&](const Index3& at) {
    const glm::dvec3 p(at);
    double value = 100 * std::sin(a * p.x + 0.3 * p.z) * std::cos(b * p.y) + 3 * p.z;
    if (at.x > dims.x / 2) value += 150;
    value = std::min(value + noise * randomReal(random, 0, 1), most);
    voxels.push_back(static_cast<float>(std::round(value)));
  });
  return voxels;
}

struct Volume {
  ReferencePyramid pyramid;
  ValueRange values;

  Volume(Random& random, const Index3& dims) {
    const std::vector<float> voxels = randomVoxels(random, dims);
    for (const float voxel : voxels) values.include(voxel);
    pyramid = buildReferencePyramid<float>(dims, voxels);
  }
  ErrorBins bins(std::uint32_t count) const {
    const int last = std::min(kMostErrorLevel, pyramid.lattice.levels() - 1);
    // Some isovalues lie beyond the bins.
    const double width = static_cast<double>(values.max - values.min) * 0.9 / count;
    return {static_cast<double>(values.min) + width, width, count, last};
  }
  ErrorChunk::Read read() const {
    return [this](int level, const IndexBox& box, float* out) {
      forEachIndex(box, [&](const Index3& sample) { *out++ = pyramid.sampleAt(level, sample); });
    };
  }
};

// Chunks of few cells, so that small volumes have many.
std::vector<IndexBox> chunksOf(const Lattice& lattice, const Index3& edges) {
  std::vector<IndexBox> chunks;
  const Index3 count = (lattice.cells(0) + edges - Index3(1)) / edges;
  forEachIndex({Index3(0), count}, [&](const Index3& at) {
    const Index3 first = at * edges;
    chunks.push_back({first, glm::min(edges, lattice.cells(0) - first)});
  });
  return chunks;
}

// The codes of all cells of a level and all bins, bin by bin: the greatest of all chunks'.
std::vector<std::uint8_t> allCodes(const Volume& volume, const ErrorBins& bins, int level,
                                   const Index3& chunk_edges) {
  const Lattice& lattice = volume.pyramid.lattice;
  const Index3 cells = lattice.cells(level);
  const auto per_bin = static_cast<std::size_t>(elementCount(cells));
  std::vector<std::uint8_t> codes(bins.count * per_bin, 0);
  ErrorChunk chunk;
  for (const IndexBox& box : chunksOf(lattice, chunk_edges)) {
    chunk.find(lattice, bins, volume.values, box, volume.read());
    const ErrorCodes& found = chunk.codes(level);
    for (std::uint32_t bin = found.first_bin; bin < found.first_bin + found.bins; ++bin)
      forEachIndex(found.cells, [&](const Index3& cell) {
        std::uint8_t& code =
            codes[bin * per_bin + static_cast<std::size_t>(linearIndex(cell, cells))];
        const std::uint8_t more =
            found.bin(bin)[linearIndex(cell - found.cells.first, found.cells.count)];
        EXPECT_TRUE(more == 0 || found.isUsed(bin));
        code = std::max(code, more);
      });
  }
  return codes;
}

const Index3 kDims[] = {{19, 14, 23}, {9, 33, 12}, {17, 17, 17}, {70, 11, 10}, {6, 68, 7}};

TEST(ErrorChunk, BoundsEveryErrorOfCellsAndOfWhatTouchesThem) {
  Random random(11);
  double sum_of_bounds = 0, sum_of_errors = 0;
  std::size_t cells = 0;
  for (const Index3& dims : kDims) {
    const Volume volume(random, dims);
    const Lattice& lattice = volume.pyramid.lattice;
    const ErrorBins bins = volume.bins(static_cast<std::uint32_t>(randomInt(random, 1, 256)));
    std::vector<float> isovalues;
    for (int i = 0; i < 2; ++i)
      isovalues.push_back(static_cast<float>(randomReal(
          random, static_cast<double>(volume.values.min), static_cast<double>(volume.values.max))));
    isovalues.push_back(std::round(isovalues[0]));
    for (int level = kFirstErrorLevel; level <= bins.last_level; ++level)
      for (const float isovalue : isovalues) {
        const std::vector<double> errors =
            referenceLeafErrors(volume.pyramid, level, static_cast<double>(isovalue));
        const std::uint32_t bin = bins.binOf(static_cast<double>(isovalue));
        const std::vector<std::uint8_t> codes =
            allCodes(volume, bins, level, Index3(64, randomInt(random, 1, 4) * 8, 16));
        ASSERT_EQ(codes.size(), bins.count * errors.size());
        for (std::size_t i = 0; i < errors.size(); ++i) {
          const std::uint8_t code = codes[bin * errors.size() + i];
          const double bound = ErrorCode::decode(code) * bins.unit();
          const Index3 cell = indexAt(static_cast<std::int64_t>(i), lattice.cells(level));
          ASSERT_LE(errors[i], bound)
              << "level " << level << " cell " << cell.x << "," << cell.y << "," << cell.z << " of "
              << dims.x << "x" << dims.y << "x" << dims.z << " at " << isovalue;
          if (bins.count < 64 || code == 255) continue;
          sum_of_bounds += bound;
          sum_of_errors += errors[i];
          ++cells;
        }
      }
  }
  // With narrow bins it is not much more than that.
  EXPECT_GT(cells, 500u);
  EXPECT_LT(sum_of_bounds, 1.5 * sum_of_errors);
}

TEST(ErrorChunk, ALinearFieldHasNoErrors) {
  const Index3 dims(21, 13, 40);
  std::vector<float> voxels;
  ValueRange values;
  forEachIndex({Index3(0), dims}, [&](const Index3& at) {
    voxels.push_back(static_cast<float>(2 * at.x - at.y + 3 * at.z));
    values.include(voxels.back());
  });
  const ReferencePyramid pyramid = buildReferencePyramid<float>(dims, voxels);
  const ErrorBins bins{static_cast<double>(values.min),
                       static_cast<double>(values.max - values.min) / 64, 64, kMostErrorLevel};
  ErrorChunk chunk;
  chunk.find(pyramid.lattice, bins, values, {Index3(0), pyramid.lattice.cells(0)},
             [&](int level, const IndexBox& box, float* out) {
               forEachIndex(box, [&](const Index3& at) { *out++ = pyramid.sampleAt(level, at); });
             });
  for (int level = kFirstErrorLevel; level <= kMostErrorLevel; ++level)
    for (const std::uint8_t code : chunk.codes(level).codes)
      ASSERT_LE(ErrorCode::decode(code), 1.5);  // rounding, in units of 1/16384 of all bins
}

TEST(ErrorChunk, IsTheSameOnEveryTargetAndForAnyChunks) {
  Random random(5);
  const Volume volume(random, {43, 26, 21});
  const ErrorBins bins = volume.bins(40);
  for (int level = kFirstErrorLevel; level <= kMostErrorLevel; ++level) {
    const std::vector<std::uint8_t> codes = allCodes(volume, bins, level, Index3(64));
    onEveryTarget([&] { EXPECT_EQ(allCodes(volume, bins, level, Index3(64)), codes); });
    EXPECT_EQ(allCodes(volume, bins, level, Index3(8)), codes);
    EXPECT_EQ(allCodes(volume, bins, level, Index3(16, 8, 8)), codes);
    EXPECT_EQ(allCodes(volume, bins, level, Index3(24, 16, 32)), codes);
  }
}

// Values close above the end of a bin, and in the same rows others in lower bins: what is said of
// those may not depend on which voxels a vector or a chunk takes together.
TEST(ErrorChunk, DoesNotDependOnHowVoxelsAreGrouped) {
  Random random(8);
  const Index3 dims(47, 12, 11);
  const double width = 64;
  std::vector<float> voxels;
  Volume volume(random, dims);
  volume.values = {};
  forEachIndex({Index3(0), dims}, [&](const Index3& at) {
    const double value = at.x < 25 ? 10 * width + randomReal(random, 0.004, 0.02) * width
                                   : randomReal(random, 2, 10) * width;
    voxels.push_back(static_cast<float>(value));
    volume.values.include(voxels.back());
  });
  volume.pyramid = buildReferencePyramid<float>(dims, voxels);
  const ErrorBins bins{0, width, 16, kMostErrorLevel};
  for (int level = kFirstErrorLevel; level <= kMostErrorLevel; ++level) {
    const std::vector<std::uint8_t> codes = allCodes(volume, bins, level, Index3(64));
    onEveryTarget([&] { EXPECT_EQ(allCodes(volume, bins, level, Index3(64)), codes); });
    EXPECT_EQ(allCodes(volume, bins, level, Index3(16)), codes);
  }
}

TEST(ErrorCode, IsTheLeastThatIsEnough) {
  for (int code = 1; code < 255; ++code)
    EXPECT_LT(ErrorCode::decode(static_cast<std::uint8_t>(code - 1)),
              ErrorCode::decode(static_cast<std::uint8_t>(code)));
  Random random(2);
  for (int i = 0; i < 20000; ++i) {
    const auto units = static_cast<float>(std::exp2(randomReal(random, -6, 17)));
    const std::uint8_t code = ErrorCode::encodeUp(units);
    ASSERT_GE(ErrorCode::decode(code), static_cast<double>(units));
    if (code > 1) {
      ASSERT_LT(ErrorCode::decode(static_cast<std::uint8_t>(code - 1)), static_cast<double>(units));
    }
    ASSERT_LE(ErrorCode::greatestWithin(static_cast<double>(units)), code);
  }
  EXPECT_EQ(ErrorCode::encodeUp(0), 0);
  EXPECT_EQ(ErrorCode::greatestWithin(-1), -1);
  EXPECT_EQ(ErrorCode::greatestWithin(0), 0);
}

}  // namespace
}  // namespace isobrick::test
