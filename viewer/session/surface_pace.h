// How much of a surface a moment allows, by the one controller of latency of a session; and how
// long users wait for surfaces.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "isobrick/viewer/stream/surface_stream.h"

namespace isobrick {

// How long a surface for a user who moves may take, seconds.
struct PaceTimes {
  double extraction = 0.06;
  double drawing = 0.06;   // of a picture, with the way to the screen
  double unhurried = 0.1;  // behind the request; from then on surfaces get smaller
};

// From the rates of the extractions and pictures so far it finds the radius that follows a user who
// moves, the steps in which the surface grows fine again at rest, and whether a slow picture waits
// for the next surface. Radii are voxels.
class SurfacePace {
 public:
  // No surface is coarser than with this radius.
  static constexpr double kLeastRadius = 8.0;
  // The view is at rest if the user has not changed anything for so long.
  static constexpr double kRestSeconds = 0.15;
  // A drawing waits so long for the next surface, if it takes longer itself.
  static constexpr double kPostponedSeconds = 0.1;

  struct Rates {
    double radius = 16.0;               // of interest: fits into the time
    double triangles_per_second = 0.0;  // extracted; 0: nothing was measured yet
    double drawn_per_second = 0.0;      // triangles drawn, by a slow renderer; 0: it is not slow
    double too_large = 0.0;  // a radius of which lately the triangles were too many; 0: none
    double finest = 0.0;     // triangles that all of the last surface has on level 0; 0: not known
  };

  SurfacePace() = default;
  explicit SurfacePace(const Rates& rates, const PaceTimes& times = {})
      : times_(times), rates_(rates) {}
  const Rates& rates() const { return rates_; }

  // After an extraction with `radius`, which made `made` of its triangles anew; it does nothing if
  // these are few. The surface within a sphere grows with the square of its radius, so the radius
  // that fits the time is found from the triangles that fit; steps are bounded, since a surface may
  // be anywhere, and end before a radius that was too large. Runs that found next to nothing leave
  // the rate as it was; few triangles may raise it, but do not lower it, as most of the time goes
  // into finding them. `finest`: as in Rates.
  void noteExtraction(double radius, std::uint64_t triangles, std::uint64_t made, double seconds,
                      double finest = 0.0);
  // After an extraction with `radius` that was given up for the triangles it had by then. The
  // radius is too large until surfaces grow to it again, a little each time.
  void noteGivenUp(double radius, std::uint64_t triangles, double seconds);
  // After a picture of so many triangles. A rasteriser in software is as slow as an extraction.
  // Pictures that take less than half the time, as graphics cards draw them, may only raise a rate,
  // and remove one that was far lower; few triangles do not lower it either.
  void noteDrawing(std::uint64_t triangles, double seconds);
  // A surface with `radius` has no room on the card: the next drag begins with one that fits.
  void noteOverBudget(double radius);

  // The radius for a user who moves on, at most `wanted`, while the shown surface has been `age`
  // seconds behind the requested one. If frames, or a surface that has suddenly grown, take longer
  // than the stream's patience, every extraction is given up for the next one, and none of them
  // gives a rate; so each gets smaller than the one before, until one is shown. A surface that has
  // more triangles than the last one on level 0, as `finest` predicts, gets a smaller radius at
  // once, and one that has fewer a larger one.
  double quickRadius(double wanted, double age, double finest = 0.0) const;
  // Beyond so many triangles a surface for a user who moves is given up for a smaller one: half as
  // many again as fit the time, as a surface may suddenly grow; 0 if nothing was measured yet.
  std::uint64_t mostTriangles() const;
  // The radii that replace `radius` if a surface has too many triangles, each half the one before,
  // down to a quarter.
  static std::vector<double> smallerRadii(double radius);
  // The radii of the passes at rest: from one that fits the time, each twice the last one, to
  // `wanted`. Each pass makes the bricks anew whose leaves are not those of the one before; even if
  // these are all, the geometric growth keeps all passes together to about a third more than the
  // last one.
  std::vector<double> passRadii(double wanted) const;
  // The remaining ones, at least one, if the one with `shown` is shown.
  static std::vector<double> finerRadii(double shown, double wanted);

  // The last picture was slow, and a user has waited for `wait` for a surface that will soon be
  // there (none: no user waits): the next picture is worth waiting for it.
  bool drawsBetterLater(const std::optional<double>& wait) const;

 private:
  double fittingTriangles() const;
  bool areMany(std::uint64_t triangles) const;
  double extractionRate(std::uint64_t triangles, double seconds) const;

  PaceTimes times_;
  Rates rates_;
  double last_drawing_ = 0.0;  // seconds
};

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
