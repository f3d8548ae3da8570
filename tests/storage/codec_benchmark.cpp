// How fast bricks are packed and unpacked, beside a plain copy of the same bytes. The bytes per
// second are those of the elements; "packed" is what they become, over what they were.
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

struct BenchmarkVolume {
  const char* phantom;
  VoxelType type;
};
constexpr BenchmarkVolume kVolumes[] = {{"head", VoxelType::kUint16},
                                        {"gyroid", VoxelType::kUint8},
                                        {"marschner-lobb", VoxelType::kFloat32}};
constexpr format::Codec kPackers[] = {format::Codec::kLz4, format::Codec::kZstd};

// The bricks of the middle slices of a phantom of 256^3 voxels, one beside the other in memory, so
// that they come from the last cache or from memory, as in a build.
std::vector<Bytes> bricksOf(const BenchmarkVolume& volume) {
  PhantomSpec spec;
  spec.name = volume.phantom;
  spec.size = 256;
  spec.voxel_type = volume.type;
  const auto source = makePhantomSource(spec);
  const auto voxel = static_cast<std::int64_t>(voxelBytes(volume.type));
  Bytes slab(static_cast<std::size_t>(kEdge * spec.size * spec.size * voxel));
  source->readRows(94 * spec.size, kEdge * spec.size, slab.data());
  std::vector<Bytes> bricks;
  for (std::int64_t y = 0; y + kEdge <= spec.size; y += kEdge)
    for (std::int64_t x = 0; x + kEdge <= spec.size; x += kEdge) {
      Bytes& brick = bricks.emplace_back(static_cast<std::size_t>(kEdge * kEdge * kEdge * voxel));
      for (std::int64_t row = 0; row < kEdge * kEdge; ++row)
        std::memcpy(
            brick.data() + row * kEdge * voxel,
            slab.data() + ((row / kEdge * spec.size + y + row % kEdge) * spec.size + x) * voxel,
            static_cast<std::size_t>(kEdge * voxel));
    }
  return bricks;
}

std::vector<EncodedPart> packedOf(const std::vector<Bytes>& bricks, VoxelType type,
                                  format::Codec codec) {
  std::vector<EncodedPart> parts;
  for (const Bytes& bytes : bricks) {
    EncodedBrick brick;
    brick.samples.bytes = bytes;
    brick.ranges.bytes.resize(2 * voxelBytes(type));
    encodeBrick(type, codec, brick);
    parts.push_back(std::move(brick.samples));
  }
  return parts;
}

void copyBricks(benchmark::State& state, const BenchmarkVolume& volume) {
  const std::vector<Bytes> bricks = bricksOf(volume);
  Bytes to(bricks[0].size());
  std::size_t next = 0;
  for (auto _ : state) {
    std::memcpy(to.data(), bricks[next++ % bricks.size()].data(), to.size());
    benchmark::DoNotOptimize(to.data());
    benchmark::ClobberMemory();
  }
  state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(to.size()));
}

// With the copy into the part that the builder makes as well, and the checksum.
void packBricks(benchmark::State& state, const BenchmarkVolume& volume, format::Codec codec) {
  const std::vector<Bytes> bricks = bricksOf(volume);
  EncodedBrick brick;
  std::size_t next = 0, packed = 0;
  for (auto _ : state) {
    const Bytes& from = bricks[next++ % bricks.size()];
    brick.samples.bytes.assign(from.begin(), from.end());
    brick.ranges.bytes.resize(2 * voxelBytes(volume.type));
    encodeBrick(volume.type, codec, brick);
    packed += brick.samples.bytes.size();
  }
  const auto bytes = static_cast<double>(next * bricks[0].size());
  state.SetBytesProcessed(static_cast<std::int64_t>(bytes));
  state.counters["packed"] = static_cast<double>(packed) / bytes;
}

void unpackBricks(benchmark::State& state, const BenchmarkVolume& volume, format::Codec codec) {
  const std::vector<Bytes> bricks = bricksOf(volume);
  const std::vector<EncodedPart> parts = packedOf(bricks, volume.type, codec);
  Bytes to(bricks[0].size());
  std::size_t next = 0;
  for (auto _ : state) {
    const EncodedPart& part = parts[next++ % parts.size()];
    if (!decodePart(part.codec, part.bytes, to.size(), to.data()))
      state.SkipWithError("cannot be unpacked");
    benchmark::DoNotOptimize(to.data());
  }
  state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(to.size()));
}

const bool g_registered = [] {
  for (const BenchmarkVolume& volume : kVolumes) {
    const std::string name =
        std::string(volume.phantom) + "/" + std::string(voxelTypeName(volume.type));
    benchmark::RegisterBenchmark(("codec/copy/" + name).c_str(), copyBricks, volume);
    for (const format::Codec codec : kPackers) {
      const std::string codec_name = codec == format::Codec::kLz4 ? "lz4/" : "zstd/";
      benchmark::RegisterBenchmark(("codec/pack/" + codec_name + name).c_str(), packBricks, volume,
                                   codec);
      benchmark::RegisterBenchmark(("codec/unpack/" + codec_name + name).c_str(), unpackBricks,
                                   volume, codec);
    }
  }
  return true;
}();

}  // namespace
}  // namespace isobrick
