// A user's waits for surfaces, and their parts.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "isobrick/viewer/stream/surface_stream.h"

namespace isobrick {

// From the oldest request that a new surface answers until the frame that shows it is begun: the
// age that the surface shown before had reached. Seconds, none below 0.
struct SurfaceWait {
  double before = 0.0;      // passes that were finished or given up first, and the thread's start
  double extraction = 0.0;  // of the surface itself
  double uploads = 0.0;     // and the rest of the interface's work, since it was extracted
  double drawing = 0.0;     // since then too, of frames that show the surface before

  double total() const { return before + extraction + uploads + drawing; }
};

// `total`, of which the last `since_ready` went by after an extraction of `extraction` seconds,
// with `drawn` of them spent on drawing.
SurfaceWait surfaceWait(double total, double extraction, double since_ready, double drawn);

// When frames were drawn lately. Times are of one clock, in seconds.
class DrawingTimes {
 public:
  // Ascending, apart from each other.
  void add(double begin, double end);
  // The seconds since `moment` that were spent on drawing, in the last 240 frames.
  double since(double moment) const;

 private:
  std::deque<std::pair<double, double>> frames_;
};

// The requests that are not answered, and what became of those that were. Moments are seconds of
// one clock, the frames', but for those of drawings and of passes, which are of clockSeconds().
class SurfaceWaits {
 public:
  using Times = std::map<std::uint64_t, std::optional<double>>;
  using Entry = Times::node_type;

  // Of a request to come, for add(), which does not fail. `since`: the user waits from then on;
  // none: the shown surface answers the request, coarser.
  static Entry entry(const std::optional<double>& since) { return Times{{0, since}}.extract(0); }
  void add(std::uint64_t request, Entry entry);
  // `pass` will be shown at `now`: the wait for the requests that it answers is over.
  void end(const StreamMessage& pass, double now);
  // Nothing will answer them.
  void giveUp() { times_.clear(); }
  void noteDrawing(double begin, double end) { drawings_.add(begin, end); }

  bool areThereAny() const { return !times_.empty(); }
  // Seconds for which the user has waited for a surface that is not shown yet; none without one.
  std::optional<double> longest(double now) const;
  // Those that ended since clearEnded().
  const std::vector<SurfaceWait>& ended() const { return ended_; }
  void clearEnded() { ended_.clear(); }

 private:
  Times times_;  // by request
  DrawingTimes drawings_;
  std::vector<SurfaceWait> ended_;
};

}  // namespace isobrick
