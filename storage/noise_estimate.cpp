#include "isobrick/storage/noise_estimate.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "isobrick/storage/voxel_type.h"

namespace isobrick {
namespace {

constexpr std::size_t kMostBricks = 16;
constexpr std::int64_t kEnoughRows = 250;  // of a brick

// Some bricks of level 0 with samples in the file. At most 2^16 are looked at, so that the table of
// a large file is not passed over.
std::vector<std::size_t> someBricks(const Pyramid& pyramid) {
  const auto all = static_cast<std::size_t>(elementCount(pyramid.layout().bricks(0)));
  constexpr std::size_t kMostRows = std::size_t{1} << 16;
  const std::size_t step = (all + kMostRows - 1) / kMostRows;
  std::vector<std::size_t> rows;
  for (std::size_t row = 0; row < all; row += step) {
    const BrickAddress at = pyramid.brickAt(row);
    if (pyramid.sampleBytes(at.level, at.brick) > 0) rows.push_back(row);
  }
  if (rows.size() <= kMostBricks) return rows;
  std::vector<std::size_t> some;
  for (std::size_t n = 0; n < kMostBricks; ++n)
    some.push_back(rows[(2 * n + 1) * rows.size() / (2 * kMostBricks)]);
  return some;
}

template <typename T>
void addSecondDifferences(const BrickSamples& samples, std::vector<float>& magnitudes) {
  const Index3& count = samples.box.count;
  const std::int64_t rows = count.y * count.z;
  for (std::int64_t row = 0; row < rows; row += std::max<std::int64_t>(1, rows / kEnoughRows)) {
    const T* voxels = samples.data<T>() + row * count.x;
    for (std::int64_t i = 1; i + 1 < count.x; ++i) {
      const auto a = static_cast<float>(voxels[i - 1]), b = static_cast<float>(voxels[i]),
                 c = static_cast<float>(voxels[i + 1]);
      if (a != b || b != c) magnitudes.push_back(std::abs((a - b) - (b - c)));
    }
  }
}

}  // namespace

double estimateNoise(const Pyramid& pyramid) {
  std::vector<float> magnitudes;
  for (const std::size_t row : someBricks(pyramid)) {
    const BrickAddress at = pyramid.brickAt(row);
    const BrickSamples samples = pyramid.samples(at.level, at.brick);
    visitVoxelType(pyramid.spec().voxel_type, [&](auto tag) {
      addSecondDifferences<typename decltype(tag)::Type>(samples, magnitudes);
    });
    pyramid.throwIfReadsFailed(at.level, at.brick);
  }
  if (magnitudes.empty()) return 0;
  const auto middle = magnitudes.begin() + static_cast<std::ptrdiff_t>(magnitudes.size() / 2);
  std::nth_element(magnitudes.begin(), middle, magnitudes.end());
  return static_cast<double>(*middle) / (0.6745 * std::sqrt(6.0));
}

}  // namespace isobrick
