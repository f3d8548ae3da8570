// The cost of a query around a focus in a session that is warm: many random focus points and
// isovalues, one after the other. ISOBRICK_BENCHMARK_PYRAMID: the file (needed);
// ISOBRICK_BENCHMARK_ISOVALUES: "least greatest" ("600 1200"); ISOBRICK_BENCHMARK_RADIUS: in voxels
// (38); ISOBRICK_BENCHMARK_TRIANGLES: in place of the radius, every query has the one that gives
// about as many; ISOBRICK_BENCHMARK_QUERIES: how many (500).
#include <benchmark/benchmark.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <random>
#include <sstream>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/vertex_numbering.h"

namespace isobrick {
namespace {

std::string setting(const char* name, const char* otherwise) {
  const char* text = std::getenv(name);
  return text != nullptr ? text : otherwise;
}

double quantile(const std::vector<double>& sorted, double part) {
  return sorted[static_cast<std::size_t>(part * static_cast<double>(sorted.size() - 1))];
}

// The radius around the query's focus at which the surface has about `triangles` of them.
double radiusOf(Extractor& extractor, Query query, std::uint64_t triangles) {
  double low = 0, high = 512;
  while (high - low > 0.25) {
    query.focus->radius = 0.5 * (low + high);
    CountingSink sink;
    (extractor.extract(query, sink).triangles < triangles ? low : high) = query.focus->radius;
  }
  return high;
}

void focusQueries(benchmark::State& state) {
  const std::string path = setting("ISOBRICK_BENCHMARK_PYRAMID", "");
  if (path.empty()) {
    state.SkipWithError("set ISOBRICK_BENCHMARK_PYRAMID to a file");
    return;
  }
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                  static_cast<std::size_t>(state.range(0)));
  const Pyramid pyramid(path, std::uint64_t{16} << 30);
  std::istringstream isovalues(setting("ISOBRICK_BENCHMARK_ISOVALUES", "600 1200"));
  double least = 0, greatest = 0;
  isovalues >> least >> greatest;
  const double radius = std::stod(setting("ISOBRICK_BENCHMARK_RADIUS", "38"));
  const auto queries = std::stoul(setting("ISOBRICK_BENCHMARK_QUERIES", "500"));

  const std::uint64_t wanted = std::stoull(setting("ISOBRICK_BENCHMARK_TRIANGLES", "0"));

  Extractor extractor(pyramid);
  SurfaceMesh mesh;
  std::mt19937 random(1);
  const auto between = [&](double a, double b) {
    return std::uniform_real_distribution<double>(a, b)(random);
  };
  std::vector<Query> all(queries);
  for (Query& query : all) {
    query.isovalue = between(least, greatest);
    glm::dvec3 center;
    for (int axis = 0; axis < 3; ++axis)
      center[axis] = between(0.2, 0.8) * static_cast<double>(pyramid.spec().voxels[axis]);
    query.focus = FocusSphere{center, radius};
    if (wanted > 0) query.focus->radius = radiusOf(extractor, query, wanted);
  }
  const auto run = [&](std::vector<double>& seconds, double& triangles) {
    for (const Query& query : all) {
      const auto begin = std::chrono::steady_clock::now();
      triangles += static_cast<double>(extractor.extract(query, mesh).triangles);
      seconds.push_back(
          std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count());
    }
  };
  std::vector<double> seconds;
  double triangles = 0;
  run(seconds, triangles);  // warm
  for (auto _ : state) {
    seconds.clear();
    triangles = 0;
    run(seconds, triangles);
  }
  double sum = 0;
  for (const double s : seconds) sum += s;
  std::sort(seconds.begin(), seconds.end());
  state.counters["triangles"] = triangles / static_cast<double>(queries);
  state.counters["median_ms"] = 1e3 * quantile(seconds, 0.5);
  state.counters["p99_ms"] = 1e3 * quantile(seconds, 0.99);
  state.counters["mtri_s"] = 1e-6 * triangles / sum;
}
BENCHMARK(focusQueries)->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace
}  // namespace isobrick
