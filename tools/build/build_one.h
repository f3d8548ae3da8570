// One volume becomes a pyramid.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "isobrick/preprocess/input_identity.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "tools/build/open_input.h"
#include "tools/json_output.h"
#include "tools/progress_bar.h"

namespace isobrick {

// The form of progress: the text before each phase, and the style.
struct ShownAs {
  std::string label;
  ProgressStyle style = ProgressStyle::kBar;
};

// The two halves of every command that builds a pyramid, with a progress bar, until Ctrl-C: opens a
// volume or phantom, and builds the pyramid of one. All but progress, cancel flag and version is
// up to `options`.
std::unique_ptr<VolumeSource> openShowingProgress(const InputOptions& input,
                                                  std::uint64_t memory_bytes,
                                                  const ShownAs& shown = {});
BuildReport buildShowingProgress(VolumeSource& source, InputWatch& input, const std::string& output,
                                 BuildOptions options, const ShownAs& shown = {});
// The options with progress, cancel flag and version; `shown` and `bar` outlive their use.
BuildOptions showingProgress(BuildOptions options, const ShownAs& shown, ProgressBar& bar);

// The same for all volumes of a run of `isobrick build`.
struct BuildSettings {
  BuildOptions options;
  int threads = 1;
  bool rebuild = false;  // builds pyramids that are up to date too
  bool force = false;    // replaces a file that is not a pyramid of the same input
  bool index = false;    // leaves level 0 in the input
  // Not empty: in place of the job's output, a pyramid in this folder (tools/pyramid_cache.h), or
  // the one beside the input if that is up to date.
  std::string cache_folder = {};
  std::uint64_t most_cached_bytes = 0;  // volumes of more are not put there; 0: no bound
  bool only_facts = false;              // a pyramid that is not in the cache is not built
  bool verbose = false;                 // the summary has a line for each phase
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
  Json facts = nullptr;  // of the volume, in place of a pyramid that was not built
  VolumeInfo volume;     // its notes name replaced voxels too
  BuildReport report;
  PyramidBytes bytes;
  int levels = 0;
  std::uint64_t bricks = 0;
  std::uint64_t fresh_bytes = 0;  // the part of bytes.raw that was not taken over from earlier
  double open_seconds = 0;
  double seconds = 0;  // all of it

  // Bytes of voxels that this run worked on, in a second of `of_seconds`; 0 if there were none.
  double megabytesPerSecond(double of_seconds) const {
    return of_seconds > 0 ? static_cast<double>(fresh_bytes) / 1e6 / of_seconds : 0;
  }
};

// Builds unless the output is up to date. Throws as openInput and buildPyramid do, and Error if the
// output is not to be replaced or memory runs out.
BuiltVolume buildOne(const BuildJob& job, const BuildSettings& settings);

// Calls `build` with the threads of the settings, after the input's options were checked; says what
// to do if memory or threads run out.
void buildWithThreads(const BuildJob& job, const BuildSettings& settings,
                      const std::function<void()>& build);

// BuildOptions::source_record of the job's index, or nothing if the settings want none. Throws
// Error if the source cannot be one.
std::string recordOfJob(const BuildJob& job, const BuildSettings& settings,
                        const VolumeSource& source);

// True if `output` is a pyramid of this very source and these options already; false if there is
// none, or one that was made from the same input, which has changed since or is to be built with
// other options. If it was made from something else, or its origin is unknown, throws Error; with
// `force`, which replaces it, false. `input_identity` is that of the source.
bool isUpToDate(const std::string& output, const VolumeInfo& info,
                const std::string& input_identity, const BuildOptions& options, bool force);

}  // namespace isobrick
