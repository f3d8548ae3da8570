// How fast bricks are packed (lz4, or zstd: 1) and unpacked, beside a plain copy of the same bytes.
// The bytes per second are those of the elements; "packed" is what they become, over what they
// were.
#include <benchmark/benchmark.h>

#include <cstring>
#include <vector>

#include "isobrick/preprocess/phantoms/phantom.h"
#include "isobrick/storage/brick_encoder.h"

namespace isobrick {
namespace {

using Bytes = std::vector<std::byte>;

// Samples of a brick of 64^3 cells, aprons included.
constexpr std::int64_t kEdge = 67;

constexpr format::Codec kPackers[] = {format::Codec::kLz4, format::Codec::kZstd};

// The bricks of the middle slices of a head phantom of 256^3 voxels, one beside the other in
// memory, so that they come from the last cache or from memory, as in a build.
const std::vector<Bytes>& headBricks() {
  static const std::vector<Bytes> all = [] {
    PhantomSpec spec;
    spec.name = "head";
    spec.size = 256;
    spec.voxel_type = VoxelType::kUint16;
    const auto source = makePhantomSource(spec);
    constexpr std::int64_t kRow = 2 * kEdge;
    Bytes slab(static_cast<std::size_t>(2 * kEdge * spec.size * spec.size));
    source->readRows(94 * spec.size, kEdge * spec.size, slab.data());
    std::vector<Bytes> bricks;
    for (std::int64_t y = 0; y + kEdge <= spec.size; y += kEdge)
      for (std::int64_t x = 0; x + kEdge <= spec.size; x += kEdge) {
        Bytes& brick = bricks.emplace_back(static_cast<std::size_t>(kEdge * kEdge * kRow));
        for (std::int64_t row = 0; row < kEdge * kEdge; ++row)
          std::memcpy(
              brick.data() + row * kRow,
              slab.data() + 2 * ((row / kEdge * spec.size + y + row % kEdge) * spec.size + x),
              kRow);
      }
    return bricks;
  }();
  return all;
}

EncodedBrick encoded(const Bytes& from, format::Codec codec) {
  EncodedBrick brick;
  brick.samples.bytes.assign(from.begin(), from.end());
  brick.ranges.bytes.resize(2 * voxelBytes(VoxelType::kUint16));
  encodeBrick(VoxelType::kUint16, codec, brick);
  return brick;
}

void copyBrick(benchmark::State& state) {
  Bytes to(headBricks()[0].size());
  std::size_t next = 0;
  for (auto _ : state) {
    std::memcpy(to.data(), headBricks()[next++ % headBricks().size()].data(), to.size());
    benchmark::DoNotOptimize(to.data());
    benchmark::ClobberMemory();
  }
  state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(to.size()));
}

// With the copy into the part that the builder makes as well, and the checksum.
void packBrick(benchmark::State& state) {
  const format::Codec codec = kPackers[state.range(0)];
  std::size_t next = 0, packed = 0;
  for (auto _ : state)
    packed += encoded(headBricks()[next++ % headBricks().size()], codec).samples.bytes.size();
  const auto bytes = static_cast<double>(next * headBricks()[0].size());
  state.SetBytesProcessed(static_cast<std::int64_t>(bytes));
  state.counters["packed"] = static_cast<double>(packed) / bytes;
}

void unpackBrick(benchmark::State& state) {
  std::vector<EncodedPart> parts;
  for (const Bytes& brick : headBricks())
    parts.push_back(encoded(brick, kPackers[state.range(0)]).samples);
  Bytes to(headBricks()[0].size());
  std::size_t next = 0;
  for (auto _ : state) {
    const EncodedPart& part = parts[next++ % parts.size()];
    if (!decodePart(part.codec, part.bytes, to.size(), to.data()))
      state.SkipWithError("cannot be unpacked");
    benchmark::DoNotOptimize(to.data());
  }
  state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(to.size()));
}

BENCHMARK(copyBrick);
BENCHMARK(packBrick)->ArgName("zstd")->Arg(0)->Arg(1);
BENCHMARK(unpackBrick)->ArgName("zstd")->Arg(0)->Arg(1);

}  // namespace
}  // namespace isobrick
