#include "isobrick/viewer/session/path_finder.h"

#include <tbb/task_arena.h>

#include <algorithm>

#include "isobrick/extract/extractor.h"

namespace isobrick {

PathFinder::PathFinder(std::shared_ptr<const Pyramid> pyramid, int threads, int first_level)
    : pyramid_(std::move(pyramid)),
      threads_(std::max(1, threads)),
      first_level_(first_level),
      worker_([this](const ViewMeasurement& measurement, const CancelFlag& cancel) {
        return find(measurement, cancel);
      }) {}

void PathFinder::update(const std::vector<ViewMeasurement>& wanted) {
  if (auto outcome = worker_.poll()) {
    FoundPath& found = found_.emplace_back(std::move(outcome->request), FoundPath{}).second;
    if (outcome->result) found.path = std::move(*outcome->result);
    found.error = std::move(outcome->error);
    current_.reset();
    if (found_.size() > 2 * kMostMeasurements) found_.pop_front();
  }
  const auto next = std::find_if(wanted.rbegin(), wanted.rend(), [&](const auto& measurement) {
    return measurement.surface_isovalue && pathOf(measurement) == nullptr;
  });
  if (next == wanted.rend()) {
    if (current_) worker_.cancel();
    current_.reset();
  } else if (current_ != *next) {
    current_ = *next;
    done_ = 0.0f;
    worker_.request(*next);
  }
}

const FoundPath* PathFinder::pathOf(const ViewMeasurement& measurement) const {
  const auto found = std::ranges::find(found_, measurement, &decltype(found_)::value_type::first);
  return found != found_.end() ? &found->second : nullptr;
}

// On the worker's thread.
SurfacePath PathFinder::find(const ViewMeasurement& measurement, const CancelFlag& cancel) {
  Extractor extractor(*pyramid_);
  const SurfacePathEnds ends{*measurement.surface_isovalue, measurement.points[0],
                             measurement.points[1]};
  SurfacePathBounds bounds;
  bounds.most_bytes = std::min(kMostBytes, pyramid_->budgetBytes());
  bounds.cancel = &cancel;
  bounds.fraction_done = &done_;
  SurfacePath path;
  tbb::task_arena arena(threads_);
  arena.execute([&] { path = findSurfacePath(extractor, *pyramid_, ends, bounds); });
  path.level += first_level_;
  return path;
}

}  // namespace isobrick
