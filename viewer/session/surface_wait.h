// The parts of a user's wait for a surface.
#pragma once

#include <deque>
#include <utility>

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

}  // namespace isobrick
