// The pieces of a surface, listed in the background: its connected components by area.
#pragma once

#include <atomic>
#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/extract/sinks/surface_components.h"
#include "isobrick/storage/pyramid.h"
#include "isobrick/viewer/state/view_pieces.h"
#include "isobrick/viewer/stream/latest_worker.h"

namespace isobrick {

// Lists all of a surface at level 0, or at the finest level whose crossed bricks have few enough
// cells. All members are for one thread and never wait, but the destructor, which waits for the end
// of a list that is given up.
class PieceList {
 public:
  static constexpr std::uint64_t kMostCells = std::uint64_t{1} << 31;

  // `threads`: of the extraction.
  PieceList(std::shared_ptr<const Pyramid> pyramid, int threads,
            std::uint64_t most_cells = kMostCells);

  struct Listed {
    double isovalue = 0.0;
    int level = 0;
    std::vector<SurfaceComponent> pieces;  // largest area first
  };

  // A new list; the one before goes on being shown until it is there. With a point of the world,
  // the piece that is nearest to it is selected then.
  void request(double isovalue, const std::optional<glm::dvec3>& point);
  void cancel() { worker_.cancel(); }
  // Takes a list that has come. True: there is one, or an error.
  bool update();
  bool busy() const { return worker_.busy(); }
  // Of the list under way, 0 .. 1.
  float progress() const { return done_; }

  const std::optional<Listed>& listed() const { return listed_; }
  // Of the last list that ended without a result; empty: none did.
  const std::string& error() const { return error_; }

  // The place of the user's piece in the list.
  const std::optional<std::size_t>& selected() const { return selected_; }
  void select(const std::optional<std::size_t>& place) { selected_ = place; }
  // The piece there; null: there is none.
  const SurfaceComponent* selectedPiece() const;

 private:
  struct Request {
    double isovalue = 0.0;
    std::optional<glm::dvec3> point;
  };
  struct Result {
    Listed listed;
    std::optional<std::size_t> selected;
  };
  Result list(const Request& request, const CancelFlag& cancel);

  const std::shared_ptr<const Pyramid> pyramid_;
  const int threads_;
  const std::uint64_t most_cells_;
  std::atomic<float> done_{0.0f};
  std::optional<Listed> listed_;
  std::optional<std::size_t> selected_;
  std::string error_;
  LatestWorker<Request, Result> worker_;  // last: its thread uses the above
};

}  // namespace isobrick
