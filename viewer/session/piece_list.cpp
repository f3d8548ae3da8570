#include "isobrick/viewer/session/piece_list.h"

#include <tbb/task_arena.h>

#include <algorithm>
#include <utility>

#include "isobrick/extract/extractor.h"

namespace isobrick {

PieceList::PieceList(std::shared_ptr<const Pyramid> pyramid, int threads, std::uint64_t most_cells)
    : pyramid_(std::move(pyramid)),
      threads_(std::max(1, threads)),
      most_cells_(most_cells),
      worker_([this](const Request& request, const CancelFlag& cancel) {
        return list(request, cancel);
      }) {}

void PieceList::request(double isovalue, const std::optional<glm::dvec3>& point) {
  error_.clear();
  worker_.request({isovalue, point});
}

bool PieceList::update() {
  auto outcome = worker_.poll();
  if (!outcome) return false;
  error_ = std::move(outcome->error);
  if (outcome->result) {
    listed_ = std::move(outcome->result->listed);
    selected_ = outcome->result->selected;
  }
  return true;
}

const SurfaceComponent* PieceList::selectedPiece() const {
  return listed_ && selected_ && *selected_ < listed_->pieces.size() ? &listed_->pieces[*selected_]
                                                                     : nullptr;
}

// On the worker's thread.
PieceList::Result PieceList::list(const Request& request, const CancelFlag& cancel) {
  done_ = 0.0f;
  Extractor extractor(*pyramid_);
  Query query;
  query.isovalue = request.isovalue;
  query.cancel = &cancel;
  query.fraction_done = &done_;
  Result result;
  result.listed.isovalue = request.isovalue;
  tbb::task_arena arena(threads_);
  arena.execute([&] {
    const auto side = static_cast<std::uint64_t>(pyramid_->layout().brickCells());
    const std::uint64_t of_brick = side * side * side;
    const int last = pyramid_->lattice().levels() - 1;
    int& level = result.listed.level;
    query.uniform_level = 0;
    ExtractionPlan plan = extractor.plan(query);
    while (level < last && plan.bricks().size() > most_cells_ / of_brick) {
      query.uniform_level = ++level;
      plan = extractor.plan(query);
    }
    ComponentPoints points;
    if (request.point) points.points.push_back(*request.point);
    ComponentFinder finder(query, std::move(points));
    extractor.execute(plan, 0, plan.bricks().size(), finder);
    const SurfaceComponents components = finder.take();
    result.listed.pieces = components.list();
    if (request.point) result.selected = components.atPoints()[0];
  });
  return result;
}

}  // namespace isobrick
