// The rows of a benchmark: which there are, and their measurement in turns, each in a process of
// its own.
//
// A row's process is called with `--row NAME --repeat N [--cold] [--mesh PATH]` behind its words,
// writes its mesh to PATH (surface_distance.h), and prints an object of JSON: numbers `triangles`,
// `vertices`, `output_bytes`, `load_seconds`, `prepare_seconds`, `first_seconds`,
// `processor_seconds`, `loaded_rss_bytes`, `peak_rss_bytes`, a list `seconds` and a text `note`.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/storage/error.h"
#include "tools/bench/surface_distance.h"
#include "tools/json_output.h"

namespace isobrick {

struct BenchSettings {
  std::string path;
  double isovalue = 0;
  int threads = 1;
  int rounds = 5;
  int repeats = 3;
  bool cold = false;
  std::vector<std::string> only;  // names of rows; empty: all
  bool with_distances = true;

  std::string own_executable;
  std::vector<std::string> own_words;    // of every row of ours: file, isovalue, threads, ...
  std::vector<std::string> query_words;  // of the adaptive row; empty: there is none
  std::optional<std::string> peers_executable;
};

struct BenchRow {
  std::string name;
  bool approximates = false;            // its distance to the finest surface is of interest
  std::vector<std::string> call_words;  // executable and words
  std::string file;                     // what it reads

  std::vector<Json> measurements;     // one a round
  std::vector<double> cached_shares;  // cold: of the file, when the row's process started
  std::optional<OneWayDistance> to_finest, from_finest;  // both or none
  std::string failure;                                   // not empty: why it was given up

  bool isMeasured() const { return failure.empty() && !measurements.empty(); }
};

// The name of the row that extracts the finest level everywhere.
inline constexpr char kFinestRow[] = "isobrick";
inline constexpr char kAdaptiveRow[] = "isobrick-adaptive";
// Begins the names of rows that simplify the finest level; a value of --simplify follows.
inline constexpr char kSimplifyRows[] = "simplify-";

// The work in progress, the number of its steps that are done, and of all.
using BenchProgress = std::function<void(const char* what, std::size_t done, std::size_t all)>;

// Measures the rows, those that the peers' executable lists among them. A row whose process fails
// is given up (BenchRow::failure), the others go on. Needs room in the folder for temporary files:
// peers read the voxels from a file without a header, and meshes go through files to be compared.
// `voxels` are the volume's. Throws Error, also if a name in settings.only is not that of a row,
// and Cancelled.
std::vector<BenchRow> measureRows(const BenchSettings& settings, const Index3& voxels,
                                  const CancelFlag* cancel, const BenchProgress& progress);

}  // namespace isobrick
