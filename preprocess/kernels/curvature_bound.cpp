#include "isobrick/preprocess/kernels/curvature_bound.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "isobrick/storage/deviation_code.h"
#include "isobrick/storage/index_loop.h"

namespace isobrick {
namespace {

// Level 1 is within half a voxel of level 0: what is farther serves queries of no use (rho < 3).
constexpr std::uint8_t kMostUsefulCode = DeviationCode::encodeUp(0.5f);

// How many samples of a block have each code, for every part of its range.
class BlockSamples {
 public:
  BlockSamples(const ValueRange& range, double epsilon)
      : low_(range.min),
        scale_(1 / (range.max - range.min)),
        least_gradient_(static_cast<float>(epsilon)) {
    if (!std::isfinite(scale_)) scale_ = 0;
  }

  // 0 at the range's low end, 1 at its high one: no sum or square of these overflows.
  template <typename T>
  float placeInRange(T value) const {
    return (static_cast<float>(value) - low_) * scale_;
  }
  float leastGradient() const { return least_gradient_; }

  // One whose value has that place.
  void add(float place, float deviation) {
    const int part = static_cast<int>(place * kDeviationCoefficients);
    ++counts_[static_cast<std::size_t>(std::min(part, kDeviationCoefficients - 1))]
             [std::min(DeviationCode::encodeUp(deviation), kUnknown)];
  }

  // For each part of the range the smallest code that three quarters of its samples keep; where
  // none counts, the greater one of the nearest parts that have some, and infinity if no part has.
  void store(std::uint8_t* codes) const {
    std::array<int, kDeviationCoefficients> kept;
    for (std::size_t part = 0; part < kept.size(); ++part) kept[part] = keptOf(counts_[part]);
    for (std::size_t part = 0; part < kept.size(); ++part) {
      int code = kept[part];
      for (std::size_t i = part; code < 0 && i > 0; --i) code = kept[i - 1];
      for (std::size_t i = part + 1; kept[part] < 0 && i < kept.size(); ++i)
        if (kept[i] >= 0) {
          code = std::max(code, kept[i]);
          break;
        }
      codes[part] = code < 0 || code == kUnknown ? 255 : static_cast<std::uint8_t>(code);
    }
  }

 private:
  static constexpr std::uint8_t kUnknown = DeviationCode::kMost + 1;
  using Counts = std::array<std::uint32_t, kUnknown + 1>;

  static int keptOf(const Counts& counts) {
    std::uint32_t all = 0, kept = 0;
    for (const std::uint32_t count : counts) all += count;
    if (all == 0) return -1;
    int code = -1;
    while (4 * kept < 3 * all) kept += counts[static_cast<std::size_t>(++code)];
    return code;
  }

  float low_, scale_, least_gradient_;
  std::array<Counts, kDeviationCoefficients> counts_{};
};

// The samples of level 0 at the lower corner of a cell of level 1 and in it, up to eight, each with
// its distance from the surface through it to that of level 1: the difference of the two levels'
// values, over the slope of level 1 in the cell. `extent`: the cell's voxels along each axis, 1 if
// level 1 is clamped there.
template <typename T>
void addCell(const SampleBlock<T>& samples, const SampleBlock<T>& coarse, const Index3& cell,
             const Index3& extent, BlockSamples& block) {
  float corners[2][2][2];
  for (int z = 0; z < 2; ++z)
    for (int y = 0; y < 2; ++y) {
      const T* const row = &coarse.at(cell + Index3(0, y, z));
      for (int x = 0; x < 2; ++x) corners[z][y][x] = block.placeInRange(row[x]);
    }
  // Four times the slopes.
  float along[3] = {};
  for (int i = 0; i < 2; ++i)
    for (int j = 0; j < 2; ++j) {
      along[0] += corners[i][j][1] - corners[i][j][0];
      along[1] += corners[i][1][j] - corners[i][0][j];
      along[2] += corners[1][i][j] - corners[0][i][j];
    }
  float squared = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const float slope = along[axis] / static_cast<float>(4 * extent[axis]);
    squared += slope * slope;
  }
  const float gradient = std::sqrt(squared);
  if (!(gradient >= block.leastGradient()) || !(gradient > 0)) return;
  const float inverse = 1 / gradient;
  for (std::int64_t z = 0; z < extent.z; ++z)
    for (std::int64_t y = 0; y < extent.y; ++y) {
      const T* const row = &samples.at(std::int64_t{2} * cell + Index3(0, y, z));
      for (std::int64_t x = 0; x < extent.x; ++x) {
        float sum = 0;  // of eight corners, each as often as the sample is near to it
        for (std::int64_t i = 0; i < 2; ++i)
          for (std::int64_t j = 0; j < 2; ++j)
            for (std::int64_t k = 0; k < 2; ++k) sum += corners[i & z][j & y][k & x];
        const float place = block.placeInRange(row[x]);
        if (place != place) continue;  // no data
        block.add(place, std::abs(sum * 0.125f - place) * inverse);
      }
    }
}

}  // namespace

template <typename T>
void brickCurvature(const BrickLayout& layout, const Index3& brick, const SampleBlock<T>& samples,
                    const SampleBlock<T>& coarse, std::span<const ValueRange> tiles, double epsilon,
                    std::vector<std::uint8_t>& codes) {
  const IndexBox cells = layout.brickCellBox(0, brick);
  const Index3 blocks = layout.brickCurvatureBlocks(brick);
  const std::int64_t edge = layout.curvatureCells();
  codes.assign(static_cast<std::size_t>(kDeviationCoefficients * elementCount(blocks)), 0);
  if (coarse.data == nullptr) return;
  bool has_contrast = false, is_any_useful = false;
  std::uint8_t* to = codes.data();
  forEachIndex({Index3(0), blocks}, [&](const Index3& at) {
    const ValueRange range = curvatureBlockRange(layout, brick, tiles, at);
    if (range.min < range.max) {
      BlockSamples block(range, epsilon);
      const Index3 first = cells.first + edge * at;
      const Index3 end = glm::min(first + Index3(edge), cells.end());
      const Index3 coarse_first = first / std::int64_t{2};
      forEachIndex({coarse_first, BrickLayout::ceilDivide(end, 2) - coarse_first},
                   [&](const Index3& cell) {
                     addCell(samples, coarse, cell,
                             glm::min(Index3(2), end - std::int64_t{2} * cell), block);
                   });
      block.store(to);
      has_contrast = true;
      is_any_useful =
          is_any_useful || std::any_of(to, to + kDeviationCoefficients,
                                       [](std::uint8_t code) { return code <= kMostUsefulCode; });
    }
    to += kDeviationCoefficients;
  });
  if (has_contrast && !is_any_useful) codes.clear();
}

#define ISOBRICK_INSTANTIATE(T)                                                               \
  template void brickCurvature<T>(const BrickLayout&, const Index3&, const SampleBlock<T>&,   \
                                  const SampleBlock<T>&, std::span<const ValueRange>, double, \
                                  std::vector<std::uint8_t>&);
ISOBRICK_FOR_EACH_VOXEL_TYPE(ISOBRICK_INSTANTIATE)
#undef ISOBRICK_INSTANTIATE

}  // namespace isobrick
