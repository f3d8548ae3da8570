// bench_pyramid_peers FILE.isb ROW LEVELS THREADS REPEATS: the time in which another library makes
// a pyramid of the voxels of FILE.isb in memory, as JSON. A row of tools/benchmark.sh; without
// arguments it lists the rows.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <tbb/global_control.h>

#include <chrono>
#include <cstdlib>
#include <exception>

#include "isobrick/storage/error.h"
#include "isobrick/storage/voxel_type.h"
#include "tools/bench/peers/peer_engines.h"
#include "tools/bench/peers/pyramid_peers.h"
#include "tools/bench/process_memory.h"
#include "tools/line_words.h"

namespace isobrick {
namespace {

#ifdef ISOBRICK_WITH_ITK
constexpr char kItkRows[] = "itkRecursivePyramid\nitkBinShrink\n";
#else
constexpr char kItkRows[] = "";
#endif
#ifdef ISOBRICK_WITH_OPENVDB
constexpr char kOpenVdbRows[] = "openvdbMultiResGrid\n";
#else
constexpr char kOpenVdbRows[] = "";
#endif

// Both libraries get floats: MultiResGrid has no integers, and ITK computes in them.
PeerVolume floatsOf(const char* path) {
  const Level0Volume file(path);
  std::vector<char> voxels(file.bytes());
  file.copyTo(voxels.data());
  const auto count = file.voxels();
  PeerVolume volume{{}, count[0], count[1], count[2]};
  visitVoxelType(voxelTypeNamed(file.typeName()).value(), [&](auto tag) {
    using T = typename decltype(tag)::Type;
    const T* const first = reinterpret_cast<const T*>(voxels.data());
    const auto last = first + voxels.size() / sizeof(T);
    for (const T* voxel = first; voxel != last; ++voxel)
      volume.values.push_back(static_cast<float>(*voxel));
  });
  return volume;
}

std::unique_ptr<PeerPyramid> makePeer(const std::string& row, const PeerVolume& volume, int levels,
                                      [[maybe_unused]] int threads) {
#ifdef ISOBRICK_WITH_ITK
  if (auto peer = makeItkPyramid(row, volume, levels, threads)) return peer;
#endif
#ifdef ISOBRICK_WITH_OPENVDB
  if (auto peer = makeOpenVdbPyramid(row, volume, levels)) return peer;
#endif
  throw Error(fmt::format("there is no row '{}'; without arguments the rows are listed", row));
}

int measure(char** words) {
  const int levels = std::atoi(words[2]), threads = std::atoi(words[3]),
            repeats = std::atoi(words[4]);
  if (levels < 2 || threads < 1 || repeats < 1)
    throw Error("LEVELS must be at least 2, THREADS and REPEATS at least 1");
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                  static_cast<std::size_t>(threads));
  const PeerVolume volume = floatsOf(words[0]);
  const auto peer = makePeer(words[1], volume, levels, threads);
  peer->load();
  PeerPyramidSize size;
  std::vector<double> seconds;
  for (int i = 0; i < repeats; ++i) {
    const auto begin = std::chrono::steady_clock::now();
    size = peer->make();
    seconds.push_back(
        std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count());
  }
  fmt::print(
      "{{\"row\": \"{}\", \"levels\": {}, \"threads\": {}, \"seconds\": [{}], \"coarser_samples\": "
      "{}, "
      "\"bytes\": {}, \"peak_rss_bytes\": {}}}\n",
      words[1], levels, threads, fmt::join(seconds, ", "), size.coarser_samples, size.bytes,
      peakOfProcess());
  return 0;
}

}  // namespace
}  // namespace isobrick

int main(int argc, char** argv) {
  if (argc == 1) {
    fmt::print("{}{}", isobrick::kItkRows, isobrick::kOpenVdbRows);
    return 0;
  }
  if (argc != 6) {
    fmt::print(stderr, "usage: bench_pyramid_peers FILE.isb ROW LEVELS THREADS REPEATS\n");
    return 2;
  }
  try {
    return isobrick::measure(argv + 1);
  } catch (const std::exception& failure) {
    fmt::print(stderr, "bench_pyramid_peers: {}\n", isobrick::oneLine(failure.what()));
    return 1;
  }
}
