// What a query costs whose bytes are on the disk, beside reading as many bytes by preads of 8 MiB,
// and beside the same query where the file is in the page cache (first: of a new pyramid, which
// unpacks) and where the pyramid holds it all (warm). In turn, the file dropped from the page cache
// before the query and before the preads. ISOBRICK_BENCHMARK_PYRAMID: the file (needed);
// ISOBRICK_BENCHMARK_ISOVALUE (600). Argument 1: around a focus in the middle, else all of level 0;
// argument 2: what is packed and what is stored is read, nothing is mapped.
#include <benchmark/benchmark.h>
#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <string>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "tools/bench/page_cache.h"

namespace isobrick {
namespace {

template <typename Work>
double millisecondsOf(Work&& work) {
  const auto begin = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin)
      .count();
}

// From the begin of the file.
void readBytes(const std::string& path, std::uint64_t bytes) {
  std::vector<char> buffer(std::size_t{8} << 20);
  const int fd = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  for (std::uint64_t done = 0; done < bytes;) {
    const auto most = std::min<std::uint64_t>(buffer.size(), bytes - done);
    const ssize_t got = pread(fd, buffer.data(), most, static_cast<off_t>(done));
    if (got <= 0) break;
    done += static_cast<std::uint64_t>(got);
  }
  close(fd);
}

double medianOf(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

void coldQuery(benchmark::State& state) {
  const char* const file = std::getenv("ISOBRICK_BENCHMARK_PYRAMID");
  if (file == nullptr) {
    state.SkipWithError("set ISOBRICK_BENCHMARK_PYRAMID to a file");
    return;
  }
  const std::string path = file;
  const char* const isovalue = std::getenv("ISOBRICK_BENCHMARK_ISOVALUE");
  const FileAccess access = state.range(1) != 0 ? FileAccess::kRead : FileAccess::kMap;
  Query query;
  query.isovalue = isovalue != nullptr ? std::atof(isovalue) : 600;
  if (state.range(0) != 0) {
    const Pyramid pyramid(path);
    query.focus = FocusSphere{0.5 * glm::dvec3(pyramid.spec().voxels),
                              0.1 * static_cast<double>(pyramid.spec().voxels.x)};
  }
  std::vector<double> cold, first, warm, pread;
  std::uint64_t bytes = 0;
  SurfaceMesh mesh;
  for (auto _ : state) {
    dropFromPageCache(path);
    {
      const Pyramid pyramid(path, Pyramid::kDefaultBudgetBytes, access);
      Extractor extractor(pyramid);
      cold.push_back(millisecondsOf([&] { extractor.extract(query, mesh); }));
      bytes = pyramid.counters().bytes_read;
    }
    {
      const Pyramid pyramid(path, Pyramid::kDefaultBudgetBytes, access);
      Extractor extractor(pyramid);
      first.push_back(millisecondsOf([&] { extractor.extract(query, mesh); }));
      warm.push_back(millisecondsOf([&] { extractor.extract(query, mesh); }));
    }
    dropFromPageCache(path);
    pread.push_back(millisecondsOf([&] { readBytes(path, bytes); }));
  }
  state.counters["cold_ms"] = medianOf(cold);
  state.counters["first_ms"] = medianOf(first);
  state.counters["warm_ms"] = medianOf(warm);
  state.counters["pread_ms"] = medianOf(pread);
  state.counters["ratio"] = medianOf(cold) / std::max(medianOf(pread), medianOf(first));
  state.counters["ratio_warm"] = medianOf(cold) / std::max(medianOf(pread), medianOf(warm));
  state.counters["MB"] = 1e-6 * static_cast<double>(bytes);
}
BENCHMARK(coldQuery)->ArgsProduct({{0, 1}, {0, 1}})->Unit(benchmark::kMillisecond)->Iterations(15);

}  // namespace
}  // namespace isobrick
