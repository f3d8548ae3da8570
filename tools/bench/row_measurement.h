// One row in one process: its measurements, and their text for the process that started it.
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
  std::string mesh_path;  // file for the mesh afterwards; empty: none
};

void addRowTaskOptions(CLI::App& app, RowTask& task);
// The words from which these options make the same task.
std::vector<std::string> rowTaskWords(const RowTask& task);

struct RowMeasurement {
  SurfaceSize size;
  double load_seconds = 0;     // SurfaceEngine::load()
  double prepare_seconds = 0;  // SurfaceEngine::prepare()
  double first_seconds = 0;    // the first extraction, into memory that the process never had
  // The measured ones. Cold: a single one, load + prepare + first.
  std::vector<double> seconds;
  // Seconds of all threads for one extraction: a busy machine changes this least.
  double processor_seconds = 0;
  std::uint64_t loaded_rss_bytes = 0;  // peak until the volume was there
  std::uint64_t peak_rss_bytes = 0;    // peak of the extractions, with the volume that stays
  std::uint64_t huge_page_bytes = 0;   // at the end, with the mesh
  std::string note;
};

// Runs the engine as the task says, in this process, and writes the mesh if the task names a file.
// Call it when the threads of the task are already set up.
RowMeasurement measureRow(const RowTask& task, SurfaceEngine& engine);

// As one object of JSON, and back. Throws Error if the text is not one that the other wrote.
std::string textOf(const RowMeasurement& measurement);
RowMeasurement rowMeasurementOf(const std::string& text);

struct PeerRow {
  std::string name;           // without blanks
  bool approximates = false;  // its vertices differ from those of the finest surface
};

// A line each, and back. Throws Error if the text is not one that the other wrote.
std::string textOf(const std::vector<PeerRow>& rows);
std::vector<PeerRow> peerRowsOf(const std::string& text);

}  // namespace isobrick
