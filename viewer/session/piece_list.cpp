#include "isobrick/viewer/session/piece_list.h"

#include <tbb/task_arena.h>

#include <algorithm>
#include <utility>

#include "isobrick/viewer/session/surface_pace.h"

namespace isobrick {

PieceList::PieceList(std::shared_ptr<const Pyramid> pyramid, int threads,
                     std::shared_ptr<KnownComponents> known, std::uint64_t most_cells)
    : pyramid_(std::move(pyramid)),
      threads_(std::max(1, threads)),
      known_(std::move(known)),
      most_cells_(most_cells),
      extractor_(*pyramid_),
      worker_([this](const Request& request, const CancelFlag& cancel) {
        return list(request, cancel);
      }) {}

// A list of the same surface that is under way already is waited for, and not begun again.
void PieceList::request(double isovalue, const std::optional<glm::dvec3>& point) {
  error_.clear();
  user_ = Request{isovalue, point, true};
  const bool is_under_way = under_way_ && !under_way_->of_user && under_way_->isovalue == isovalue;
  if (!is_under_way) begin(*user_);
}

void PieceList::cancel() {
  user_.reset();
  if (!under_way_ || !under_way_->of_user) return;
  worker_.cancel();
  under_way_.reset();
}

void PieceList::begin(const Request& request) {
  worker_.request(request);
  under_way_ = request;
}

void PieceList::want(const std::set<double>& isovalues, double seconds) {
  now_ = seconds;
  const std::size_t before = wanted_.size();
  std::erase_if(wanted_, [&](const auto& wanted) { return isovalues.count(wanted.first) == 0; });
  bool are_same = wanted_.size() == before;
  for (const double isovalue : isovalues)
    are_same = !wanted_.try_emplace(isovalue).second && are_same;
  if (!are_same) wanted_since_ = seconds;
  const bool is_in_vain = under_way_ && !under_way_->of_user &&
                          wanted_.count(under_way_->isovalue) == 0 &&
                          !(user_ && user_->isovalue == under_way_->isovalue);
  if (is_in_vain) {
    worker_.cancel();
    under_way_.reset();
  }
  if (listed_ && wanted_.count(listed_->isovalue()) > 0)
    wanted_[listed_->isovalue()].listed = listed_;
}

std::shared_ptr<const ListedComponents> PieceList::wanted(double isovalue) const {
  const auto found = wanted_.find(isovalue);
  return found == wanted_.end() ? nullptr : found->second.listed;
}

bool PieceList::waits() const {
  return std::ranges::any_of(wanted_, [](const auto& wanted) {
    return !wanted.second.listed && wanted.second.error.empty();
  });
}

std::string PieceList::wantedError() const {
  for (const auto& [isovalue, wanted] : wanted_)
    if (!wanted.error.empty()) return wanted.error;
  return {};
}

void PieceList::update() {
  if (auto outcome = worker_.poll()) take(std::move(*outcome));
  if (under_way_) return;
  if (user_) return begin(*user_);
  if (now_ - wanted_since_ < SurfacePace::kRestSeconds) return;
  for (const auto& [isovalue, wanted] : wanted_)
    if (!wanted.listed && wanted.error.empty()) return begin({isovalue, std::nullopt, false});
}

void PieceList::take(LatestWorker<Request, Result>::Outcome outcome) {
  under_way_.reset();
  const bool of_user = outcome.request.of_user;
  if (of_user) {
    user_.reset();
    error_ = outcome.error;
  }
  const auto wanted = wanted_.find(outcome.request.isovalue);
  if (wanted != wanted_.end()) {
    if (outcome.result) wanted->second.listed = outcome.result->listed;
    wanted->second.error = std::move(outcome.error);
  }
  if (!of_user || !outcome.result) return;
  listed_ = std::move(outcome.result->listed);
  selected_ = outcome.result->selected;
}

const SurfaceComponent* PieceList::selectedPiece() const {
  return listed_ && selected_ && *selected_ < listed_->list().size() ? &listed_->list()[*selected_]
                                                                     : nullptr;
}

// On the worker's thread.
PieceList::Result PieceList::list(const Request& request, const CancelFlag& cancel) {
  done_ = 0.0f;
  Query query;
  query.isovalue = request.isovalue;
  query.cancel = &cancel;
  Result result;
  tbb::task_arena arena(threads_);
  arena.execute([&] {
    const auto side = static_cast<std::uint64_t>(pyramid_->layout().brickCells());
    const std::uint64_t most_bricks = most_cells_ / (side * side * side);
    const int last = pyramid_->lattice().levels() - 1;
    int level = 0;
    for (; level < last; ++level) {
      query.uniform_level = level;
      if (extractor_.plan(query).bricks().size() <= most_bricks) break;
    }
    result.listed =
        known_->findOrList(extractor_, *pyramid_, {request.isovalue, level, &cancel, &done_});
    if (!request.point) return;
    result.selected = result.listed->nearest(extractor_, {{*request.point}}, &cancel)[0];
  });
  done_ = 1.0f;
  return result;
}

}  // namespace isobrick
