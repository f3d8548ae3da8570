// The surfaces of a view: what is asked of the stream, when and how fine, and what is shown of it.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/viewer/session/shown_volume.h"
#include "isobrick/viewer/session/surface_pace.h"
#include "isobrick/viewer/stream/chunk_store.h"
#include "isobrick/viewer/stream/surface_set.h"
#include "isobrick/viewer/stream/surface_stream.h"
#include "isobrick/viewer/stream/value_histogram.h"

namespace isobrick {

// The surfaces that are shown: of which request, and how fine.
class ShownSurfaces {
 public:
  // `pass` is shown from now on; `asked`: by its request.
  void take(const StreamMessage& pass, const SurfaceWish& asked);
  void forget() { surfaces_.clear(); }

  // The pass that is shown; before the first one, one of request 0.
  const StreamMessage& pass() const { return pass_; }
  std::uint64_t passes() const { return passes_; }
  // A surface is shown that is what `wish` asks for, all of it as fine as with radius `least`, or
  // finer, but not finer than with `most`.
  bool has(std::size_t surface, const SurfaceWish& wish, double least, double most) const;

  std::uint64_t triangles() const;
  // Of all surfaces together, by the pyramid's levels.
  std::vector<LevelCounts> levels() const;
  // Pieces that users chose and that are not there.
  std::size_t lostPieces() const;
  // A surface that is shown, by its number; null: it is not.
  const StreamedSurface* surface(std::size_t number) const;

 private:
  struct Shown {
    SurfaceWish::Surface surface;
    SurfaceWish::Detail detail;
    double radius = 0.0;
    bool is_complete = false;
    StreamedSurface counts;
  };
  std::map<int, Shown> surfaces_;  // by number
  StreamMessage pass_;
  std::uint64_t passes_ = 0;
};

// While a view changes, it is answered by one pass that fits the time; at rest by all passes up to
// the wanted radius. A budget that is reached makes surfaces smaller. Belongs to the store's
// thread. Time is the caller's: seconds that run on.
class SurfaceRequests {
 public:
  // `volume` and `histogram`, which predicts triangles, outlive it. `budget`: of chunks in the
  // store; `threads`: of the extraction; `known`: the lists of components that it uses and adds to.
  // `on_news` and `delivery` are those of the stream, `times` those of the pace.
  SurfaceRequests(const ShownVolume& volume, const ValueHistogram& histogram, ChunkStore& store,
                  ChunkBudget budget, int threads, std::shared_ptr<KnownComponents> known,
                  std::function<void()> on_news = {}, ChunkDelivery delivery = {},
                  const PaceTimes& times = {});

  // For each frame, in this order: takes what has come, within `allowance`, and asks for the
  // surfaces of the view.
  void take(double seconds, UploadAllowance& allowance);
  void request(const SurfaceWish& wish, double seconds);

  // Gives back all that the store keeps, which may end then. Until resume() nothing else is called.
  void suspend();
  void resume(ChunkStore& store);

  // Of a picture of the surfaces, with showing it; or of so many triangles, somewhere else.
  void noteDrawing(double seconds);
  void noteDrawing(std::uint64_t triangles, double seconds) {
    pace_.noteDrawing(triangles, seconds);
  }
  // The user sees the answer to the last change from now on: the view is at rest so much later.
  void noteSeen(double seconds) {
    if (!asked_for_all_) last_change_ = seconds;
  }
  bool drawsBetterLater() const { return pace_.drawsBetterLater(longestWait()); }

  const ShownSurfaces& shown() const { return shown_; }
  std::vector<ChunkId> chunks() const { return surfaces_->shown(); }
  std::uint64_t chunkBytes() const { return surfaces_->shownBytes(); }
  // The least box around them, in samples; none if that is nothing.
  std::optional<std::array<glm::dvec3, 2>> shownBox() const { return surfaces_->shownBox(); }

  // Something was shown, or there is nothing to show.
  bool hasShown() const;
  // The surfaces of the view are shown, as fine as they get.
  bool isFine(const SurfaceWish& wish) const;
  bool isFollowingUser() const { return !asked_for_all_; }
  // As SurfaceStream::request() numbers it; 0: there was none.
  std::uint64_t latestRequest() const { return last_request_; }
  // Those of the latest request, and all of their bricks were there.
  bool showsTheLatest() const;
  bool isOverBudget() const { return over_budget_; }
  // Of the last extraction or upload; empty: it went well.
  const std::string& error() const { return surfaces_->error(); }

  const SurfacePace& pace() const { return pace_; }
  // What ValueHistogram::trianglesAt() says, times this, are triangles at the shown detail; 0: not
  // known.
  double shareOfFinest() const { return share_of_finest_; }
  // Seconds since the shown surface was last the requested one; none: it is.
  std::optional<double> longestWait() const { return waits_.longest(now_); }
  // For the surfaces that the last take() began to show.
  const std::vector<SurfaceWait>& waits() const { return waits_.ended(); }
  // Seconds since a pass was last shown or requested.
  double sinceNews() const;

 private:
  std::optional<StreamMessage> nextMessage();
  void takePass(const StreamMessage& pass);
  void shrinkToBudget();
  double finestTriangles(const SurfaceWish& wish) const;
  StreamValues wantedValues() const;
  bool changesAtRest(const SurfaceWish& wish) const;
  void requestAtRest(const SurfaceWish& wish, bool waits);
  bool isShown(std::size_t surface, double radius) const;
  StreamPass passOf(double radius) const;
  void boundFirstPass(StreamRequest& request) const;
  void requestQuickly(double radius);
  void requestPasses(const std::vector<double>& radii, bool at_once);
  void send(StreamRequest request, const std::optional<double>& waiting_since);

  const ShownVolume& volume_;
  const ValueHistogram& histogram_;
  const ChunkBudget budget_;
  const std::shared_ptr<KnownComponents> known_;
  SurfacePace pace_;
  SurfaceWaits waits_;
  ShownSurfaces shown_;

  double now_ = 0.0;
  std::optional<SurfaceWish> requested_;        // by the last request
  std::map<std::uint64_t, SurfaceWish> asked_;  // by request, from the one that is shown on
  std::uint64_t last_request_ = 0;
  std::uint64_t forgotten_request_ = 0;  // the last one whose chunks are of no use
  double share_of_finest_ = 0.0;
  double first_radius_ = 0.0;   // of the latest request's first pass
  std::set<int> kept_;          // surfaces that all requests under way keep
  double last_change_ = 0.0;    // when a request last differed from the one before
  bool asked_for_all_ = false;  // since then
  bool all_passes_done_ = false;
  bool ask_again_ = false;   // the request could not be answered any longer
  bool shows_less_ = false;  // than the stream's messages contained
  bool over_budget_ = false;
  double last_news_ = 0.0;  // of clockSeconds()

  std::optional<SurfaceSet> surfaces_;
  SurfaceStream stream_;  // last: its thread uses the pyramid
};

}  // namespace isobrick
