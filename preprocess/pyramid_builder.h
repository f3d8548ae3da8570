// The preprocessing as a whole: a volume source in, a verified pyramid file out.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "preprocess/volume_source.h"
#include "storage/cancel.h"
#include "storage/pyramid_info.h"

namespace isobrick {

// Called now and then by one thread at a time: the phase's name and how much of it is done, 0 .. 1.
using BuildProgress = std::function<void(std::string_view phase, double fraction)>;

struct BuildOptions {
  std::int64_t brick_cells = 64;
  std::int64_t tile_cells = 4;
  format::Filter filter = format::Filter::kAverage;
  bool with_curvature = true;
  // See PyramidSpec::curvature_epsilon.
  double curvature_epsilon = 1.0 / 64;
  // Value that takes the place of NaN and infinite voxels; without it they are refused.
  std::optional<float> nan_as;
  std::string tool_version;
  const CancelFlag* cancel = nullptr;
  BuildProgress progress;
};

struct BuildPhase {
  std::string name;
  double seconds = 0;
};

struct BuildReport {
  std::vector<BuildPhase> phases;
  double seconds = 0;
  std::uint64_t file_bytes = 0;
  std::uint64_t replaced_voxels = 0;  // by nan_as
};

// Reads `source` to its end and writes a pyramid to `path`, which appears only when it is complete
// and durable. Uses the calling TBB arena. The levels are held in memory: about 1.2 times the
// volume's bytes. The file does not depend on the number of threads. Throws Error (bad input, no
// space, ...) or Cancelled.
BuildReport buildPyramid(VolumeSource& source, const std::string& path,
                         const BuildOptions& options);

}  // namespace isobrick
