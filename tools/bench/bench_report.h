// The report of a benchmark: an object of JSON, or tables to read.
#pragma once

#include <algorithm>
#include <cstddef>
#include <string>
#include <vector>

#include "isobrick/storage/grid.h"
#include "tools/bench/bench_plan.h"
#include "tools/json_output.h"

namespace isobrick {

// The machine and the volume that it ran on.
struct BenchScene {
  Index3 voxels{0};
  std::string voxel_type;
  std::string processor;
  int cores = 0;
  double load_before = 0, load_after = 0;  // processes ready to run, mean of a minute
};

// Reads the facts of the machine; load_before is the present load.
BenchScene makeBenchScene(const Index3& voxels, const std::string& voxel_type);
// Processes ready to run, mean of the last minute.
double machineLoad();

// {"file", "isovalue", ..., "rows": [{"name", "triangles", "threads", "seconds": {...}, ...}]}: see
// docs/lab.md. A row that was given up has its name and settings, and "failure".
Json jsonOfBench(const BenchSettings& settings, const BenchScene& scene,
                 const std::vector<BenchRow>& rows);

// Tables, one for each setting of cache and pages, then distances.
std::string textOfBench(const BenchSettings& settings, const BenchScene& scene,
                        const std::vector<BenchRow>& rows);

struct Spread {
  double median = 0, min = 0, max = 0;
};

// `values` has one value at least. Between two in the middle the median is their mean.
inline Spread spreadOf(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const std::size_t half = values.size() / 2;
  const double median =
      values.size() % 2 == 1 ? values[half] : 0.5 * (values[half - 1] + values[half]);
  return {median, values.front(), values.back()};
}

}  // namespace isobrick
