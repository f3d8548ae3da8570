// The SIMD kernels against their definitions, on every instruction set that the machine has.
#include <gtest/gtest.h>

#include <cstring>

#include "isobrick/preprocess/kernels/low_pass.h"
#include "isobrick/preprocess/kernels/tile_ranges.h"
#include "tests/support/array_source.h"
#include "tests/support/every_target.h"
#include "tests/support/random_numbers.h"

namespace isobrick::test {
namespace {

template <typename T>
T randomVoxel(Random& random) {
  if constexpr (std::is_floating_point_v<T>)
    return static_cast<T>(randomReal(random, -1e6, 1e6));
  else
    // The ends of the range are where sums overflow.
    return randomBelow(random, 4) == 0
               ? std::numeric_limits<T>::max()
               : static_cast<T>(randomInt(random, std::numeric_limits<T>::lowest(),
                                          std::numeric_limits<T>::max()));
}

// A block with gaps between its rows and slices, in a buffer of just its size.
template <typename T>
struct StridedBlock {
  IndexBox box;
  std::vector<T> values;
  SampleBlock<T> view;

  StridedBlock(const IndexBox& b, Random& random) : box(b) {
    const std::int64_t row = box.count.x + randomInt(random, 0, 5);
    const std::int64_t slice = box.count.y * row + randomInt(random, 0, 7);
    values.resize(static_cast<std::size_t>((box.count.z - 1) * slice + (box.count.y - 1) * row +
                                           box.count.x));
    for (T& value : values) value = randomVoxel<T>(random);
    view = {values.data(), box, row, slice};
  }
};

// One sample by the words of rule 2.
template <typename T>
T lowPassSample(const Lattice& lattice, int level, format::Filter filter,
                const SampleBlock<T>& fine, const Index3& i) {
  LowPassTap taps[3];
  int axes = 0;
  for (int axis = 0; axis < 3; ++axis) {
    taps[axis] = lowPassTap(lattice, level, filter, axis, i[axis]);
    axes += taps[axis].filtered ? 1 : 0;
  }
  using Sum = std::conditional_t<std::is_floating_point_v<T>, double, std::int64_t>;
  const auto sumAlong = [](const LowPassTap& tap, auto&& at) -> Sum {
    if (!tap.filtered) return at(tap.center);
    const Sum middle = at(tap.center);
    return at(tap.center - 1) + (middle + middle) + at(tap.center + 1);
  };
  const Sum sum = sumAlong(taps[0], [&](std::int64_t x) {
    return sumAlong(taps[1], [&](std::int64_t y) {
      return sumAlong(taps[2], [&](std::int64_t z) {
        return static_cast<Sum>(fine.at({x, y, z}));
      });
    });
  });
  const std::int64_t divisor = std::int64_t{1} << (2 * axes);
  if constexpr (std::is_floating_point_v<T>)
    return static_cast<T>(sum / static_cast<double>(divisor));
  else
    return static_cast<T>((sum + divisor / 2) >> (2 * axes));
}

template <typename T>
class Kernels : public testing::Test {};
using VoxelTypes = testing::Types<std::uint8_t, std::int8_t, std::uint16_t, std::int16_t, float>;
TYPED_TEST_SUITE(Kernels, VoxelTypes);

TYPED_TEST(Kernels, LowPassEqualsItsDefinitionBitByBit) {
  using T = TypeParam;
  onEveryTarget([] {
    Random random(17);
    for (int round = 0; round < 150; ++round) {
      const Index3 voxels(randomInt(random, 2, 150), randomInt(random, 2, 40),
                          randomInt(random, 2, 40));
      const Lattice lattice(voxels);
      if (lattice.levels() < 2) continue;
      const int level = static_cast<int>(randomInt(random, 0, lattice.levels() - 2));
      const auto filter = round % 5 == 0 ? format::Filter::kSubsample : format::Filter::kAverage;
      const Index3 coarse_dims = lattice.samples(level + 1);
      IndexBox coarse;
      for (int axis = 0; axis < 3; ++axis) {
        coarse.first[axis] = randomInt(random, 0, coarse_dims[axis] - 1);
        coarse.count[axis] = randomInt(random, 1, coarse_dims[axis] - coarse.first[axis]);
      }
      const StridedBlock<T> fine(lowPassSupport(lattice, level, filter, coarse), random);
      std::vector<T> out(static_cast<std::size_t>(coarse.size()));
      lowPassBlock(lattice, level, filter, fine.view, coarse, out.data());
      for (std::int64_t n = 0; n < coarse.size(); ++n) {
        const Index3 i =
            coarse.first + Index3(n % coarse.count.x, n / coarse.count.x % coarse.count.y,
                                  n / (coarse.count.x * coarse.count.y));
        const T expected = lowPassSample(lattice, level, filter, fine.view, i);
        ASSERT_EQ(std::memcmp(&out[static_cast<std::size_t>(n)], &expected, sizeof(T)), 0)
            << "round " << round << " sample " << i.x << "," << i.y << "," << i.z;
      }
    }
  });
}

TYPED_TEST(Kernels, RangesAreThoseOfTheClosedCubes) {
  using T = TypeParam;
  onEveryTarget([] {
    Random random(18);
    for (int round = 0; round < 150; ++round) {
      const IndexBox cells = {
          Index3(randomInt(random, 0, 9), randomInt(random, 0, 9), 3),
          Index3(randomInt(random, 1, 80), randomInt(random, 1, 20), randomInt(random, 1, 20))};
      const std::int64_t edge = std::int64_t{1} << randomBelow(random, 6);
      const StridedBlock<T> block({cells.first - Index3(randomInt(random, 0, 1)),
                                   cells.count + Index3(2 + randomInt(random, 0, 1))},
                                  random);
      CubeRanges<T> ranges;
      ranges.reset(BrickLayout::ceilDivide(cells.count, edge));
      ranges.max[0] = std::numeric_limits<T>::max();  // ranges are widened, never narrowed
      includeClosedCubes(block.view, cells, edge, ranges);
      Index3 cube;
      std::size_t n = 0;
      for (cube.z = 0; cube.z < ranges.dims.z; ++cube.z)
        for (cube.y = 0; cube.y < ranges.dims.y; ++cube.y)
          for (cube.x = 0; cube.x < ranges.dims.x; ++cube.x, ++n) {
            const Index3 first = cells.first + cube * edge;
            const Index3 last = glm::min(first + Index3(edge), cells.end());
            T least = std::numeric_limits<T>::max(), greatest = std::numeric_limits<T>::lowest();
            for (std::int64_t z = first.z; z <= last.z; ++z)
              for (std::int64_t y = first.y; y <= last.y; ++y)
                for (std::int64_t x = first.x; x <= last.x; ++x) {
                  least = std::min(least, block.view.at({x, y, z}));
                  greatest = std::max(greatest, block.view.at({x, y, z}));
                }
            if (n == 0) greatest = std::numeric_limits<T>::max();
            ASSERT_EQ(ranges.min[n], least) << "round " << round;
            ASSERT_EQ(ranges.max[n], greatest) << "round " << round;
          }
    }
  });
}

}  // namespace
}  // namespace isobrick::test
