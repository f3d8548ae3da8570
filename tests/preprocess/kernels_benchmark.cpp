// How fast the low-pass and the ranges of one brick (uint16) are, beside a plain copy of its
// voxels.
#include <benchmark/benchmark.h>

#include <cstring>
#include <random>
#include <vector>

#include "isobrick/preprocess/brick_window.h"
#include "isobrick/preprocess/kernels/low_pass.h"
#include "isobrick/preprocess/kernels/tile_ranges.h"

namespace isobrick {
namespace {

// The middle brick of 3 x 3 x 3, with all that is made of it. Twelve of them are used in turn, so
// that they come from the last cache or memory, as in a build.
struct BrickData {
  PyramidSpec spec;
  BrickNeeds needs;
  IndexBox brick = {Index3(1), Index3(1)};
  IndexBox box;
  std::vector<std::vector<std::uint16_t>> volumes;
  std::size_t next = 0;

  BrickData() : spec(makeSpec()), needs(spec), box(needs.samples(0, brick)) {
    std::mt19937 random(1);
    for (int i = 0; i < 12; ++i) {
      std::vector<std::uint16_t> values(static_cast<std::size_t>(box.size()));
      for (std::uint16_t& value : values) value = static_cast<std::uint16_t>(random() & 0x7F);
      volumes.push_back(std::move(values));
    }
  }
  static PyramidSpec makeSpec() {
    PyramidSpec spec;
    spec.voxels = Index3(3 * 64 + 1);
    return spec;
  }
  SampleBlock<std::uint16_t> block() {
    return SampleBlock<std::uint16_t>::dense(volumes[next++ % volumes.size()].data(), box);
  }
  std::int64_t voxelBytes() const {
    return 64 * 64 * 64 * static_cast<std::int64_t>(sizeof(std::uint16_t));
  }
};

void copyOfBrick(benchmark::State& state) {
  BrickData data;
  std::vector<std::uint16_t> to(static_cast<std::size_t>(data.voxelBytes()) /
                                sizeof(std::uint16_t));
  for (auto _ : state) {
    std::memcpy(to.data(), data.block().data, to.size() * sizeof(std::uint16_t));
    benchmark::DoNotOptimize(to.data());
    benchmark::ClobberMemory();
  }
  state.SetBytesProcessed(state.iterations() * data.voxelBytes());
}

void lowPassOfBrick(benchmark::State& state) {
  BrickData data;
  const IndexBox coarse = data.needs.samplesAbove(0, data.brick, 1);
  std::vector<std::uint16_t> to(static_cast<std::size_t>(coarse.size()));
  for (auto _ : state) {
    lowPassBlock(data.needs.layout().lattice(), 0, format::Filter::kAverage, data.block(), coarse,
                 to.data());
    benchmark::DoNotOptimize(to.data());
    benchmark::ClobberMemory();
  }
  state.SetBytesProcessed(state.iterations() * data.voxelBytes());
}

void rangesOfBrick(benchmark::State& state) {
  BrickData data;
  CubeRanges<std::uint16_t> ranges;
  for (auto _ : state) {
    ranges.reset(Index3(16));
    includeClosedCubes(data.block(), data.needs.cellsAbove(0, data.brick, 0), 4, ranges);
    benchmark::DoNotOptimize(ranges.min.data());
    benchmark::ClobberMemory();
  }
  state.SetBytesProcessed(state.iterations() * data.voxelBytes());
}

BENCHMARK(copyOfBrick);
BENCHMARK(lowPassOfBrick);
BENCHMARK(rangesOfBrick);

}  // namespace
}  // namespace isobrick
