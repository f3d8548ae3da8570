// The figures of a session's work, for the user; and the times of frames, for the panel and as JSON
// for a script's report.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <string>
#include <utility>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/viewer/session/surface_pace.h"
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

// How long one frame took, in seconds.
struct FrameTimes {
  double interface = 0.0;  // events, state, panel, requests and uploads
  double draw = 0.0;       // the scene and the panel, by the graphics card or the processor
};

struct ReportedFrame {
  double seconds = 0.0;  // since the begin
  FrameTimes times;
  bool scene_drawn = true;  // and not only shown again, as nothing in it changed
  double surface_age = 0.0;
  double shown_radius = 0.0;
  std::uint64_t triangles = 0;
  std::uint64_t triangles_made = 0;
  std::uint64_t uploaded_bytes = 0;
  std::vector<SurfaceWait> waits;
};

// docs/reference/views-and-scripts.md has the fields. `device`: that drew; `status`: after the last
// frame.
std::string reportOf(const std::vector<ReportedFrame>& frames, const std::string& device,
                     const SessionStatus& status);

// The times of the last frames, and of all of them for a report.
class FrameLog {
 public:
  // `report_path`: empty: only the last frames are kept.
  explicit FrameLog(std::string report_path) : report_path_(std::move(report_path)) {}

  void add(ReportedFrame frame) {
    latest_.push_back(frame.times);
    if (latest_.size() > kFrameTimes) latest_.pop_front();
    if (!report_path_.empty()) frames_.push_back(std::move(frame));
  }
  const std::deque<FrameTimes>& latest() const { return latest_; }

  // If there is a path. `device`: that drew; `status`: after the last frame. Throws Error.
  void writeReport(const std::string& device, const SessionStatus& status) const;

 private:
  static constexpr std::size_t kFrameTimes = 240;

  const std::string report_path_;
  std::deque<FrameTimes> latest_;
  std::vector<ReportedFrame> frames_;
};

}  // namespace isobrick
