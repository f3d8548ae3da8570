// One row in one process: what was measured, and how it gets to the process that asked.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "tools/bench/surface_engine.h"

namespace isobrick {

struct RowTask {
  std::string row;
  int repeats = 3;  // measured extractions, after one that is not
  // The first extraction of the process is the measured one, and reading the volume is part of it.
  bool cold = false;
  bool huge_pages = true;
  std::string mesh_path;  // where the mesh goes afterwards; empty: nowhere
};

void addRowTaskOptions(CLI::App& app, RowTask& task);
// The words that these options make the same task of.
std::vector<std::string> rowTaskWords(const RowTask& task);

struct RowMeasurement {
  SurfaceSize size;
  double load_seconds = 0;     // SurfaceEngine::load()
  double prepare_seconds = 0;  // SurfaceEngine::prepare()
  double first_seconds = 0;    // the first extraction, into memory that the process never had
  // The measured ones. Cold: a single one, load + prepare + first.
  std::vector<double> seconds;
  // For all threads, for one of them: what a busy machine changes least.
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

struct PeerRow {
  std::string name;           // without blanks
  bool approximates = false;  // its vertices do not lie where those of the finest surface do
};

// A line each, and back. Throws Error where the text is not what the other wrote.
std::string textOf(const std::vector<PeerRow>& rows);
std::vector<PeerRow> peerRowsOf(const std::string& text);

}  // namespace isobrick
