// The rows of isobrick in a benchmark: a surface into memory, measured in this process.
#pragma once

#include <string>

#include "isobrick/extract/query.h"
#include "isobrick/storage/paged_file.h"
#include "tools/json_output.h"

namespace isobrick {

struct OwnRowTask {
  std::string path;
  std::uint64_t budget_bytes = 0;  // these two as in Pyramid
  FileAccess access = FileAccess::kMap;
  int repeats = 3;  // measured extractions, after one that is not
  // The first extraction of the process is the measured one, and opening the file is part of it.
  bool cold = false;
  std::string mesh_path;  // file for the mesh afterwards; empty: none
};

// What bench_rows.h expects of a row's process. Call it when the threads are already set up.
Json measureOwnRow(const OwnRowTask& task, const Query& query);

}  // namespace isobrick
