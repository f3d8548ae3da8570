// One row in one process: what was measured, and how it gets to the process that asked.
#pragma once

#include <string>
#include <vector>

#include "tools/bench/row_task.h"
#include "tools/bench/surface_engine.h"

namespace isobrick {

struct RowMeasurement {
  SurfaceSize size;
  double load_seconds = 0;     // SurfaceEngine::load()
  double prepare_seconds = 0;  // SurfaceEngine::prepare()
  double first_seconds = 0;    // the first extraction, into memory that the process never had
  // The measured ones. Cold: a single one, load + prepare + first.
  std::vector<double> seconds;
  // Of all threads, for one of them: what a busy machine changes least.
  double processor_seconds = 0;
  std::uint64_t loaded_rss_bytes = 0;  // peak until the volume was there
  std::uint64_t peak_rss_bytes = 0;    // peak of the extractions, with the volume that stays
  std::uint64_t huge_page_bytes = 0;   // at the end, with the mesh
  std::string note;
};

// Runs the engine as the task says, in this process, and writes the mesh where it wants one. To be
// called where the threads of the task are already set up.
RowMeasurement measureRow(const RowTask& task, SurfaceEngine& engine);

// As one object of JSON, and back. Throws Error where the text is not what the other wrote.
std::string textOf(const RowMeasurement& measurement);
RowMeasurement rowMeasurementOf(const std::string& text);

}  // namespace isobrick
