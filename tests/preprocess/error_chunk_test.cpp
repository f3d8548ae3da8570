// The stored error bounds against a slow reference, cell by cell and isovalue by isovalue.
#include "isobrick/preprocess/error_chunk.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "isobrick/preprocess/kernels/error_rows.h"
#include "isobrick/storage/index_loop.h"
#include "tests/support/every_target.h"
#include "tests/support/random_numbers.h"
#include "tests/support/reference_error.h"
#include "tests/support/reference_pyramid.h"

namespace isobrick::test {
namespace {

// Smooth, with some noise and a step.
std::vector<float> randomVoxels(Random& random, const Index3& dims) {
  const double a = randomReal(random, 0.1, 0.7), b = randomReal(random, 0.1, 0.7);
  const double noise = randomInt(random, 0, 1) == 0 ? 1 : 40;
  std::vector<float> voxels;
  forEachIndex({Index3(0), dims}, [&](const Index3& at) {
    const glm::dvec3 p(at);
    double value = 100 * std::sin(a * p.x + 0.3 * p.z) * std::cos(b * p.y) + 3 * p.z;
    if (at.x > dims.x / 2) value += 150;
    voxels.push_back(static_cast<float>(std::round(value + noise * randomReal(random, 0, 1))));
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
        ErrorChunk chunk;
        std::size_t found = 0;
        forEachIndex({Index3(0), ErrorChunk::chunks(lattice)}, [&](const Index3& number) {
          chunk.find(lattice, bins, volume.values, number, volume.read());
          const ErrorCodes& codes = chunk.codes(level);
          const IndexBox own = ErrorChunk::cells(lattice, level, number);
          found += static_cast<std::size_t>(own.size());
          const bool has_bin = bin >= codes.first_bin && bin < codes.first_bin + codes.bins;
          forEachIndex(own, [&](const Index3& cell) {
            const double error =
                errors[static_cast<std::size_t>(linearIndex(cell, lattice.cells(level)))];
            const std::uint8_t code =
                has_bin ? codes.bin(bin)[linearIndex(cell - codes.cells.first, codes.cells.count)]
                        : 0;
            const double bound = ErrorCode::decode(code) * bins.unit();
            ASSERT_LE(error, bound)
                << "level " << level << " cell " << cell.x << "," << cell.y << "," << cell.z
                << " of " << dims.x << "x" << dims.y << "x" << dims.z << " at " << isovalue;
            if (bins.count < 64 || code == 255) return;
            sum_of_bounds += bound;
            sum_of_errors += error;
            ++cells;
          });
        });
        EXPECT_EQ(found, errors.size());
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
  chunk.find(pyramid.lattice, bins, values, Index3(0),
             [&](int level, const IndexBox& box, float* out) {
               forEachIndex(box, [&](const Index3& at) { *out++ = pyramid.sampleAt(level, at); });
             });
  for (int level = kFirstErrorLevel; level <= kMostErrorLevel; ++level)
    for (const std::uint8_t code : chunk.codes(level).codes)
      ASSERT_LE(ErrorCode::decode(code), 1.5);  // rounding, in units of 1/16384 of all bins
}

TEST(ErrorChunk, IsTheSameOnEveryTarget) {
  Random random(5);
  const Volume volume(random, {27, 18, 21});
  const ErrorBins bins = volume.bins(40);
  std::vector<std::uint8_t> first;
  onEveryTarget([&] {
    ErrorChunk chunk;
    chunk.find(volume.pyramid.lattice, bins, volume.values, Index3(0), volume.read());
    if (first.empty()) first = chunk.codes(2).codes;
    EXPECT_EQ(chunk.codes(2).codes, first);
  });
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
