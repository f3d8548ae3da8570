// How long a query goes on after it was cancelled: queries of the whole volume, of one level and
// around a focus, cancelled at random moments. Argument 1: the file was dropped from the page cache
// and the pyramid opened anew before each. ISOBRICK_BENCHMARK_PYRAMID: the file (needed);
// ISOBRICK_BENCHMARK_ISOVALUES: "least greatest" ("600 1200"); ISOBRICK_BENCHMARK_QUERIES: how many
// (200).
#include <benchmark/benchmark.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <memory>
#include <random>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/vertex_numbering.h"
#include "tools/bench/process_memory.h"

namespace isobrick {
namespace {

using CancelClock = std::chrono::steady_clock;

double secondsSince(CancelClock::time_point begin) {
  return std::chrono::duration<double>(CancelClock::now() - begin).count();
}

// One query, cancelled after `wait` seconds. Returns for how many it went on; below 0: it had
// ended before.
double secondsAfterCancel(Extractor& extractor, Query query, bool into_memory, double wait) {
  CancelFlag flag;
  query.cancel = &flag;
  std::atomic<bool> has_begun{false}, has_ended{false};
  CancelClock::time_point requested;
  std::thread canceller([&] {
    while (!has_begun) {
    }
    const auto begin = CancelClock::now();
    while (secondsSince(begin) < wait && !has_ended)
      std::this_thread::sleep_for(std::chrono::microseconds(50));
    requested = CancelClock::now();
    flag.request();
  });
  bool is_cancelled = false;
  CancelClock::time_point ended;
  SurfaceMesh mesh;
  CountingSink sink;
  try {
    has_begun = true;
    if (into_memory)
      extractor.extract(query, mesh);
    else
      extractor.extract(query, sink);
  } catch (const Cancelled&) {
    is_cancelled = true;
  }
  ended = CancelClock::now();
  has_ended = true;
  canceller.join();
  return is_cancelled ? std::chrono::duration<double>(ended - requested).count() : -1;
}

void cancelledQueries(benchmark::State& state) {
  const char* const path = std::getenv("ISOBRICK_BENCHMARK_PYRAMID");
  if (path == nullptr) {
    state.SkipWithError("set ISOBRICK_BENCHMARK_PYRAMID to a file");
    return;
  }
  const char* text = std::getenv("ISOBRICK_BENCHMARK_ISOVALUES");
  std::istringstream isovalues(text != nullptr ? text : "600 1200");
  double least = 0, greatest = 0;
  isovalues >> least >> greatest;
  text = std::getenv("ISOBRICK_BENCHMARK_QUERIES");
  const auto queries = text != nullptr ? std::stoul(text) : 200;
  const bool is_cold = state.range(0) != 0;

  std::vector<double> seconds;
  for (auto _ : state) {
    std::mt19937 random(1);
    const auto between = [&](double a, double b) {
      return std::uniform_real_distribution<double>(a, b)(random);
    };
    auto pyramid = std::make_unique<Pyramid>(path);
    auto extractor = std::make_unique<Extractor>(*pyramid);
    seconds.clear();
    std::size_t tries = 0;
    while (seconds.size() < queries) {
      if (++tries > 100 * queries) {
        state.SkipWithError("queries end before they are cancelled; are these its isovalues?");
        return;
      }
      Query query;
      query.isovalue = between(least, greatest);
      if (random() % 2 == 0) {
        glm::dvec3 center;
        for (int axis = 0; axis < 3; ++axis)
          center[axis] = between(0.2, 0.8) * static_cast<double>(pyramid->spec().voxels[axis]);
        query.focus = FocusSphere{center, between(20, 150)};
      }
      const bool into_memory = random() % 2 == 0;
      if (is_cold) {
        extractor.reset();
        pyramid.reset();
        dropFromPageCache(path);
        pyramid = std::make_unique<Pyramid>(path);
        extractor = std::make_unique<Extractor>(*pyramid);
      }
      const double after =
          secondsAfterCancel(*extractor, query, into_memory, between(0, is_cold ? 0.2 : 0.05));
      if (after >= 0) seconds.push_back(after);
    }
  }
  std::sort(seconds.begin(), seconds.end());
  const auto quantile = [&](double part) {
    return 1e3 * seconds[static_cast<std::size_t>(part * static_cast<double>(seconds.size() - 1))];
  };
  state.counters["median_ms"] = quantile(0.5);
  state.counters["p99_ms"] = quantile(0.99);
  state.counters["greatest_ms"] = quantile(1);
}
BENCHMARK(cancelledQueries)->Arg(0)->Arg(1)->Unit(benchmark::kMillisecond)->Iterations(1);

}  // namespace
}  // namespace isobrick
