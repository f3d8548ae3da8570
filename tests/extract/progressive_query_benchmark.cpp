// How long a progressive query takes from opening the file to its first surface, and to its last:
// the file was dropped from the page cache before each. ISOBRICK_BENCHMARK_PYRAMID: the file
// (needed); ISOBRICK_BENCHMARK_ISOVALUE (600). Argument 1: around a focus in the middle, else all
// of level 0.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "tools/bench/process_memory.h"

namespace isobrick {
namespace {

void firstAndLastSurface(benchmark::State& state) {
  const char* const path = std::getenv("ISOBRICK_BENCHMARK_PYRAMID");
  if (path == nullptr) {
    state.SkipWithError("set ISOBRICK_BENCHMARK_PYRAMID to a file");
    return;
  }
  const char* const isovalue = std::getenv("ISOBRICK_BENCHMARK_ISOVALUE");
  std::vector<double> open, first, last;
  std::size_t answers = 0;
  std::uint64_t first_triangles = 0, last_triangles = 0;
  for (auto _ : state) {
    dropFromPageCache(path);
    const auto begin = std::chrono::steady_clock::now();
    const auto milliseconds = [&] {
      return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin)
          .count();
    };
    const Pyramid pyramid(path);
    open.push_back(milliseconds());
    Extractor extractor(pyramid);
    SurfaceMesh mesh;
    Query query;
    query.isovalue = isovalue != nullptr ? std::atof(isovalue) : 600;
    query.is_progressive = true;
    if (state.range(0) != 0)
      query.focus = FocusSphere{0.5 * glm::dvec3(pyramid.spec().voxels),
                                0.1 * static_cast<double>(pyramid.spec().voxels.x)};
    ExtractionReport report = extractor.extract(query, mesh);
    first.push_back(milliseconds() - open.back());
    first_triangles = report.triangles;
    for (answers = 1; !report.is_complete; ++answers) {
      if (!extractor.waitForBricks(std::chrono::milliseconds(50))) {
        state.SkipWithError("the default budget does not hold what the query needs");
        return;
      }
      report = extractor.extract(query, mesh);
    }
    last.push_back(milliseconds());
    last_triangles = report.triangles;
  }
  const auto median = [](std::vector<double>& times) {
    std::sort(times.begin(), times.end());
    return times[times.size() / 2];
  };
  state.counters["open_ms"] = median(open);
  state.counters["first_ms"] = median(first);
  state.counters["last_ms"] = median(last);
  state.counters["first_triangles"] = static_cast<double>(first_triangles);
  state.counters["last_triangles"] = static_cast<double>(last_triangles);
  state.counters["answers"] = static_cast<double>(answers);
}
BENCHMARK(firstAndLastSurface)->Arg(0)->Arg(1)->Unit(benchmark::kMillisecond)->Iterations(9);

}  // namespace
}  // namespace isobrick
