// The rows of a benchmark, and the words with which each is measured.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "tools/bench/row_measurement.h"
#include "tools/bench/surface_distance.h"

namespace isobrick {

struct BenchSettings {
  std::string path;
  double isovalue = 0;
  int threads = 1;
  int rounds = 5;
  int repeats = 3;
  std::vector<bool> cold = {false};
  std::vector<bool> huge_pages = {true};
  std::vector<std::string> only;  // names of rows; empty: all
  bool with_distances = true;

  std::string own_executable;
  std::vector<std::string> own_words;    // of every row of ours: file, isovalue, threads, ...
  std::vector<std::string> query_words;  // of the adaptive row; empty: there is none
  std::optional<std::string> peers_executable;
};

// Both ways; in voxels.
struct SurfaceError {
  OneWayDistance to_finest, from_finest;
};

struct BenchRow {
  std::string name;
  bool cold = false;
  bool huge_pages = true;
  bool approximates = false;            // its distance to the finest surface is of interest
  std::vector<std::string> call_words;  // executable and words, without those of the RowTask

  std::vector<RowMeasurement> measurements;  // one a round
  std::vector<double> cached_shares;         // cold: of the file, when the row's process started
  std::optional<SurfaceError> error;
  std::string failure;  // not empty: why it was given up
};

// The name of the row that extracts the finest level everywhere.
inline constexpr char kFinestRow[] = "isobrick";
inline constexpr char kAdaptiveRow[] = "isobrick-adaptive";
// Begins the names of rows that simplify the finest level; a value of --simplify follows.
inline constexpr char kSimplifyRows[] = "simplify-";

// All rows of all settings of caches and pages, in the order in which they are measured. Throws
// Error if a name in settings.only is not that of a row.
std::vector<BenchRow> planRows(const BenchSettings& settings, const std::vector<PeerRow>& peers);

}  // namespace isobrick
