// One volume of `isobrick build`.
#pragma once

#include <cstdint>
#include <string>

#include "isobrick/preprocess/pyramid_builder.h"
#include "tools/build/open_input.h"
#include "tools/progress_bar.h"

namespace isobrick {

// The same for all volumes of a run.
struct BuildSettings {
  BuildOptions options;  // all but `progress`
  int threads = 1;
  bool rebuild = false;      // also what is up to date
  bool force = false;        // replaces what is not a pyramid of the same input
  bool any_options = false;  // a pyramid of the same input is up to date, whatever its options
  ProgressStyle progress = ProgressStyle::kBar;
};

struct BuildJob {
  InputOptions input;
  std::string output;
  std::string label;  // before the phase in the progress bar
};

struct BuiltVolume {
  std::string output;
  bool skipped = false;  // it was up to date; then `report` is empty
  VolumeInfo volume;     // its notes tell of replaced voxels too
  BuildReport report;
  PyramidBytes bytes;
  int levels = 0;
  std::uint64_t bricks = 0;
  std::uint64_t fresh_bytes = 0;  // the part of bytes.raw that was not taken over from earlier
  double open_seconds = 0;
  double seconds = 0;  // all of it

  // Bytes of voxels that this run worked on, in a second of `of_seconds`; 0 where there were none.
  double megabytesPerSecond(double of_seconds) const {
    return of_seconds > 0 ? static_cast<double>(fresh_bytes) / 1e6 / of_seconds : 0;
  }
};

// Builds unless the output is up to date. Throws what openInput and buildPyramid throw, and Error
// where the output is not to be replaced or memory runs out.
BuiltVolume buildOne(const BuildJob& job, const BuildSettings& settings);

}  // namespace isobrick
