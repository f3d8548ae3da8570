// What the process of one row is told: the words of its command line.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

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

}  // namespace isobrick
