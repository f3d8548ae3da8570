// The paths of measurements over the surface, found in the background.
#pragma once

#include <atomic>
#include <deque>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "isobrick/storage/pyramid.h"
#include "isobrick/viewer/state/measurement.h"
#include "isobrick/viewer/stream/latest_worker.h"

namespace isobrick {

// Finds one path at a time, that of the newest measurement first: a newer one ends the search under
// way, which comes again after it. All members are for one thread and never wait, but the
// destructor, which waits for the end of a search that is given up.
class PathFinder {
 public:
  // Of a search, if the pyramid's own budget is not smaller.
  static constexpr std::uint64_t kMostBytes = std::uint64_t{1} << 30;

  // `threads`: of the extraction; `first_level`: the volume's level that the pyramid's level 0 is.
  PathFinder(std::shared_ptr<const Pyramid> pyramid, int threads, int first_level);

  // Takes a path that has come, and looks for the next one of the wanted.
  void update(const std::vector<ViewMeasurement>& wanted);
  // True if one of the wanted is not found yet.
  bool busy() const { return current_.has_value(); }
  // Of the search under way, 0 .. 1.
  float progress() const { return done_; }
  // Null: it was not wanted, or is not found yet. Valid until the next update().
  const FoundPath* pathOf(const ViewMeasurement& measurement) const;
  // The same as a function; this outlives it.
  PathOf asked() const {
    return [this](const ViewMeasurement& measurement) { return pathOf(measurement); };
  }

 private:
  SurfacePath find(const ViewMeasurement& measurement, const CancelFlag& cancel);

  const std::shared_ptr<const Pyramid> pyramid_;
  const int threads_, first_level_;
  std::atomic<float> done_{0.0f};
  // Those that are wanted no longer stay for a while: an undo may bring them back.
  std::deque<std::pair<ViewMeasurement, FoundPath>> found_;
  std::optional<ViewMeasurement> current_;
  LatestWorker<ViewMeasurement, SurfacePath> worker_;  // last: its thread uses the above
};

}  // namespace isobrick
