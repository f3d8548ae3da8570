// The cost of a query whose bytes are on the disk, beside reading the same bytes by large preads in
// the order of the file (same), as many from its begin in one run (run), and beside the same query
// where the file is in the page cache (first: of a new pyramid, which unpacks) and where the
// pyramid holds it all (warm). In turn, the file dropped from the page cache before the query and
// the preads; the ratio is that of the query to the greater of same and first.
// ISOBRICK_BENCHMARK_PYRAMID: the file (needed); ISOBRICK_BENCHMARK_ISOVALUE (600). Argument 1:
// around a focus in the middle, else all of level 0; argument 2: what is packed and what is stored
// is read, nothing is mapped.
#include <benchmark/benchmark.h>
#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <string>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/storage/pyramid_parts.h"
#include "tools/bench/process_memory.h"

namespace isobrick {
namespace {

template <typename Work>
double millisecondsOf(Work&& work) {
  const auto begin = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin)
      .count();
}

struct FileRun {
  std::uint64_t begin, end;
};

// By preads of at most 8 MiB.
void readRuns(const std::string& path, const std::vector<FileRun>& runs) {
  std::vector<char> buffer(std::size_t{8} << 20);
  const int fd = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  for (auto [at, end] : runs)
    while (at < end) {
      const auto most = std::min<std::uint64_t>(buffer.size(), end - at);
      const ssize_t got = pread(fd, buffer.data(), most, static_cast<off_t>(at));
      if (got <= 0) break;
      at += static_cast<std::uint64_t>(got);
    }
  close(fd);
}

// The runs of its file that the pyramid holds, neighbouring parts as one.
std::vector<FileRun> residentRuns(const Pyramid& pyramid) {
  std::vector<FileRun> parts, runs;
  for (std::size_t row = 0; row < pyramid.brickCount(); ++row) {
    const auto [level, brick] = pyramid.parts().brickAt(row);
    for (const PartKind kind : kPartKinds) {
      const format::PartEntry part = pyramid.parts().brickRowOf(level, brick).part(kind);
      if (part.stored_bytes > 0 && pyramid.parts().holdIfResident(kind, level, brick))
        parts.push_back({part.offset, part.offset + part.stored_bytes});
    }
  }
  std::sort(parts.begin(), parts.end(),
            [](const FileRun& a, const FileRun& b) { return a.begin < b.begin; });
  for (const FileRun& part : parts)
    if (!runs.empty() && part.begin - runs.back().end < 4096)
      runs.back().end = part.end;
    else
      runs.push_back(part);
  return runs;
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
  std::vector<double> cold, first, warm, same, run;
  std::uint64_t bytes = 0;
  std::vector<FileRun> runs;
  SurfaceMesh mesh;
  for (auto _ : state) {
    dropFromPageCache(path);
    {
      const Pyramid pyramid(path, Pyramid::kDefaultBudgetBytes, access);
      Extractor extractor(pyramid);
      cold.push_back(millisecondsOf([&] { extractor.extract(query, mesh); }));
      bytes = pyramid.parts().counters().bytes_read;
      runs = residentRuns(pyramid);
    }
    {
      const Pyramid pyramid(path, Pyramid::kDefaultBudgetBytes, access);
      Extractor extractor(pyramid);
      first.push_back(millisecondsOf([&] { extractor.extract(query, mesh); }));
      warm.push_back(millisecondsOf([&] { extractor.extract(query, mesh); }));
    }
    dropFromPageCache(path);
    same.push_back(millisecondsOf([&] { readRuns(path, runs); }));
    dropFromPageCache(path);
    run.push_back(millisecondsOf([&] { readRuns(path, {{0, bytes}}); }));
  }
  state.counters["cold_ms"] = medianOf(cold);
  state.counters["first_ms"] = medianOf(first);
  state.counters["warm_ms"] = medianOf(warm);
  state.counters["same_ms"] = medianOf(same);
  state.counters["run_ms"] = medianOf(run);
  state.counters["ratio"] = medianOf(cold) / std::max(medianOf(same), medianOf(first));
  state.counters["ratio_run"] = medianOf(cold) / std::max(medianOf(run), medianOf(first));
  state.counters["MB"] = 1e-6 * static_cast<double>(bytes);
}
BENCHMARK(coldQuery)->ArgsProduct({{0, 1}, {0, 1}})->Unit(benchmark::kMillisecond)->Iterations(15);

}  // namespace
}  // namespace isobrick
