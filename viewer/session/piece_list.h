// The pieces of surfaces, listed in the background: their connected components by area.
#pragma once

#include <atomic>
#include <cstddef>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/storage/pyramid.h"
#include "isobrick/viewer/state/measurement.h"
#include "isobrick/viewer/stream/latest_worker.h"
#include "isobrick/viewer/stream/listed_components.h"

namespace isobrick {

// Lists all of a surface at level 0, or at the finest level whose crossed bricks have few enough
// cells; a surface that is known already is not listed again. The user's list comes first, then
// those that surfaces are coloured by. All members are for one thread and never wait, but the
// destructor, which waits for the end of a list that is given up.
class PieceList {
 public:
  static constexpr std::uint64_t kMostCells = std::uint64_t{1} << 31;

  // `threads`: of the extraction; `known`: the lists that it uses and adds to.
  PieceList(std::shared_ptr<const Pyramid> pyramid, int threads,
            std::shared_ptr<KnownComponents> known, std::uint64_t most_cells = kMostCells);

  // ---- The user's list.

  // A new list; the one before goes on being shown until it is there. With a point of the world,
  // the piece that is nearest to it is selected then.
  void request(double isovalue, const std::optional<glm::dvec3>& point);
  void cancel();
  bool busy() const { return user_.has_value(); }
  // Of the list under way, 0 .. 1.
  float progress() const { return done_; }

  // Null before the first one.
  const std::shared_ptr<const ListedComponents>& listed() const { return listed_; }
  // Of the user's last list that ended without a result; empty: none did.
  const std::string& error() const { return error_; }

  const std::optional<std::size_t>& selected() const { return selected_; }
  void select(const std::optional<std::size_t>& place) { selected_ = place; }
  // The piece there; null: there is none.
  const SurfaceComponent* selectedPiece() const;

  // ---- Lists that surfaces are coloured by.

  // Those of these isovalues, and no others, are wanted at `seconds`, the caller's time. They are
  // begun at rest (SurfacePace::kRestSeconds): while a user drags an isovalue, the time is for
  // triangles.
  void want(const std::set<double>& isovalues, double seconds);
  // Null: it is not there yet, or is not wanted.
  std::shared_ptr<const ListedComponents> wanted(double isovalue) const;
  // One of the wanted ones is not there, and may come.
  bool waits() const;
  // Why a wanted one is not there and will not come; empty: there is no such one.
  std::string wantedError() const;

  void update();

 private:
  struct Request {
    double isovalue = 0.0;
    std::optional<glm::dvec3> point;
    bool of_user = false;
  };
  struct Result {
    std::shared_ptr<const ListedComponents> listed;
    std::optional<std::size_t> selected;
  };
  // A wanted list: there, or failed, or neither.
  struct Wanted {
    std::shared_ptr<const ListedComponents> listed;
    std::string error;
  };
  Result list(const Request& request, const CancelFlag& cancel);
  void begin(const Request& request);
  void take(LatestWorker<Request, Result>::Outcome outcome);

  const std::shared_ptr<const Pyramid> pyramid_;
  const int threads_;
  const std::shared_ptr<KnownComponents> known_;
  const std::uint64_t most_cells_;
  std::atomic<float> done_{0.0f};
  std::shared_ptr<const ListedComponents> listed_;
  std::optional<std::size_t> selected_;
  std::string error_;
  std::optional<Request> user_;       // until it is answered
  std::optional<Request> under_way_;  // on the worker
  std::map<double, Wanted> wanted_;   // by isovalue
  double now_ = 0.0, wanted_since_ = 0.0;
  Extractor extractor_;                   // of the worker, which keeps its memory
  LatestWorker<Request, Result> worker_;  // last: its thread uses the above
};

}  // namespace isobrick
