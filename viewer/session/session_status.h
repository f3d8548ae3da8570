// The state of a session's work, for the user.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/viewer/session/surface_requests.h"

namespace isobrick {

struct SessionStatus {
  std::string doing;            // "ready", or the work under way
  std::string limited;          // the limit on the shown surface; empty: none
  std::string error;            // of the last extraction or slice; empty: none
  double shown_radius = 0.0;    // voxels
  double wanted_radius = 0.0;   // voxels
  std::uint64_t triangles = 0;  // shown
  // By the pass that is shown: the others were shown before, in bricks that stayed the same.
  std::uint64_t triangles_made = 0;
  std::uint64_t shown_bytes = 0;  // of chunks
  std::uint64_t bricks_read = 0;  // by the pass that is shown
  double extract_seconds = 0.0;   // of the pass that is shown
  double triangles_per_second = 0.0;
  double drag_radius = 0.0;
  std::uint64_t passes = 0;  // completed
  double surface_age = 0.0;  // seconds since the shown surface was last the requested one
  std::vector<LevelCounts> levels;
};

// The figures of the surfaces of `state`, and the limit on them; `is_fine`: they, and all else that
// is shown, are as fine as they get.
SessionStatus statusOf(const SurfaceRequests& requests, const ShownVolume& volume,
                       const ViewState& state, bool is_fine);

}  // namespace isobrick
