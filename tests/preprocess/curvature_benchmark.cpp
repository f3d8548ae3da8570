// The curvature bound of bricks, in bytes of voxels a second, beside memcpy of the same bytes: one
// thread, all bricks of a volume of 129^3 voxels.

#include <benchmark/benchmark.h>

#include <cstring>
#include <random>
#include <type_traits>
#include <vector>

#include "isobrick/preprocess/curvature_bricks.h"
#include "isobrick/preprocess/phantoms/phantom.h"
#include "isobrick/storage/index_loop.h"

namespace isobrick {
namespace {

constexpr std::int64_t kSize = 129;
constexpr Index3 kDims(kSize);
constexpr double kEpsilon = 1.0 / 64;

enum class Content { kHead, kNoise };

template <typename T>
std::vector<T> makeVoxels(Content content) {
  std::vector<T> voxels(static_cast<std::size_t>(elementCount(kDims)));
  if (content == Content::kHead) {
    PhantomSpec spec;
    spec.name = "head";
    spec.size = kSize;
    spec.voxel_type = voxelTypeOf<T>();
    const Phantom phantom(spec);
    for (std::int64_t z = 0; z < kSize; ++z)
      for (std::int64_t y = 0; y < kSize; ++y)
        phantom.fillRow({0, y, z}, kSize,
                        &voxels[static_cast<std::size_t>(linearIndex({0, y, z}, kDims))]);
  } else {
    std::mt19937 random(1);
    for (T& voxel : voxels) voxel = static_cast<T>(random() >> 16);
  }
  return voxels;
}

// Ranges of the tiles from level 0 alone.
template <typename T>
std::vector<ValueRange> tileRanges(const BrickLayout& layout, const Index3& brick,
                                   const SampleBlock<T>& samples) {
  const IndexBox cells = layout.brickCellBox(0, brick);
  const Index3 tiles = layout.brickTiles(0, brick);
  std::vector<ValueRange> ranges;
  Index3 tile;
  for (tile.z = 0; tile.z < tiles.z; ++tile.z)
    for (tile.y = 0; tile.y < tiles.y; ++tile.y)
      for (tile.x = 0; tile.x < tiles.x; ++tile.x) {
        const Index3 first = cells.first + tile * layout.tileCells();
        const Index3 last = glm::min(first + Index3(layout.tileCells()), cells.end());
        ValueRange& range = ranges.emplace_back();
        Index3 at;
        for (at.z = first.z; at.z <= last.z; ++at.z)
          for (at.y = first.y; at.y <= last.y; ++at.y)
            for (at.x = first.x; at.x <= last.x; ++at.x)
              range.include(static_cast<float>(samples.at(at)));
      }
  return ranges;
}

std::vector<Index3> allBricks(const BrickLayout& layout) {
  const Index3 count = layout.bricks(0);
  std::vector<Index3> bricks;
  for (std::int64_t i = 0; i < elementCount(count); ++i) bricks.push_back(indexAt(i, count));
  return bricks;
}

template <typename T, Content kContent>
void benchmarkCurvature(benchmark::State& state) {
  const std::vector<T> voxels = makeVoxels<T>(kContent);
  const auto samples = SampleBlock<T>::dense(voxels.data(), {Index3(0), kDims});
  const BrickLayout layout(Lattice(kDims), 64, 4);
  const std::vector<Index3> bricks = allBricks(layout);
  std::vector<std::vector<ValueRange>> tiles;
  for (const Index3& brick : bricks) tiles.push_back(tileRanges(layout, brick, samples));
  std::vector<std::uint8_t> codes;
  std::size_t nodes = 0;
  for (auto _ : state)
    for (std::size_t i = 0; i < bricks.size(); ++i) {
      brickCurvature(layout, bricks[i], samples, tiles[i], kEpsilon, codes);
      nodes += codes.size() / 3;
      benchmark::DoNotOptimize(codes.data());
    }
  state.SetBytesProcessed(state.iterations() *
                          static_cast<std::int64_t>(voxels.size() * sizeof(T)));
  state.counters["s_per_node"] = benchmark::Counter(
      static_cast<double>(nodes), benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}

template <typename T>
void benchmarkCopy(benchmark::State& state) {
  const auto from = makeVoxels<T>(Content::kNoise);
  std::vector<T> to(from.size());
  for (auto _ : state) {
    std::memcpy(to.data(), from.data(), from.size() * sizeof(T));
    benchmark::ClobberMemory();
  }
  state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(from.size() * sizeof(T)));
}

BENCHMARK(benchmarkCopy<std::uint8_t>)->Name("Curvature/memcpy/uint8");
BENCHMARK(benchmarkCopy<std::uint16_t>)->Name("Curvature/memcpy/uint16");
BENCHMARK(benchmarkCopy<float>)->Name("Curvature/memcpy/float32");

BENCHMARK_TEMPLATE(benchmarkCurvature, std::uint8_t, Content::kHead)->Name("Curvature/head/uint8");
BENCHMARK_TEMPLATE(benchmarkCurvature, std::uint16_t, Content::kHead)
    ->Name("Curvature/head/uint16");
BENCHMARK_TEMPLATE(benchmarkCurvature, float, Content::kHead)->Name("Curvature/head/float32");
BENCHMARK_TEMPLATE(benchmarkCurvature, std::uint8_t, Content::kNoise)
    ->Name("Curvature/noise/uint8");
BENCHMARK_TEMPLATE(benchmarkCurvature, std::uint16_t, Content::kNoise)
    ->Name("Curvature/noise/uint16");
BENCHMARK_TEMPLATE(benchmarkCurvature, float, Content::kNoise)->Name("Curvature/noise/float32");

}  // namespace
}  // namespace isobrick
