// The report of a benchmark: an object of JSON, or tables to read.
#pragma once

#include <string>
#include <vector>

#include "isobrick/storage/grid.h"
#include "tools/bench/bench_rows.h"
#include "tools/json_output.h"

namespace isobrick {

// The volume, and the machine when the measurement began.
struct BenchScene {
  Index3 voxels{0};
  std::string voxel_type;
  double load_before = 0;
};

// Processes ready to run, mean of the last minute.
double machineLoad();

// {"file", "isovalue", ..., "rows": [{"name", "triangles", "threads", "seconds": {...}, ...}]}: see
// docs/lab.md. A row that was given up has its name and settings, and "failure".
Json jsonOfBench(const BenchSettings& settings, const BenchScene& scene,
                 const std::vector<BenchRow>& rows);

// The same object as tables: times, then distances.
std::string textOfBench(const Json& bench);

}  // namespace isobrick
