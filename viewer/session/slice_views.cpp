#include "isobrick/viewer/session/slice_views.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <glm/geometric.hpp>
#include <utility>

namespace isobrick {
namespace {

std::uint64_t nextNumber() {
  static std::atomic<std::uint64_t> last{0};
  return ++last;
}

// Of a sampling for a slice that may be moving: some 10 ms.
constexpr double kQuickPixels = 250'000.0;

int quickDivisor(int width, int height) {
  return std::max(
      1, static_cast<int>(std::ceil(
             std::sqrt(static_cast<double>(width) * static_cast<double>(height) / kQuickPixels))));
}

// The coarsest level with a sample or more to each value.
int levelFor(const Lattice& lattice, double voxels_per_value) {
  int level = 0;
  while (level + 1 < lattice.levels() && std::ldexp(1.0, level + 1) <= voxels_per_value) ++level;
  return level;
}

}  // namespace

std::optional<double> SliceViews::Shown::valueAt(const glm::dvec2& pixel) const {
  const int x = static_cast<int>(std::floor(pixel.x / pixels));
  const int y = static_cast<int>(std::floor(pixel.y / pixels));
  if (x < 0 || y < 0 || x >= values.width || y >= values.height) return std::nullopt;
  const float value =
      values.values[static_cast<std::size_t>(y) * static_cast<std::size_t>(values.width) +
                    static_cast<std::size_t>(x)];
  if (std::isnan(value)) return std::nullopt;
  return values.transform.real(static_cast<double>(value));
}

SliceViews::SliceViews(std::shared_ptr<const Pyramid> pyramid, double step)
    : pyramid_(std::move(pyramid)),
      step_(step),
      worker_([this](const Job& job, const CancelFlag& cancel) { return sample(job, cancel); }) {}

void SliceViews::want(int view, const SliceFrame& frame, int width, int height) {
  wanted_[static_cast<std::size_t>(view)] = Wanted{frame, width, height};
}

void SliceViews::forget() {
  wanted_ = {};
  done_ = {};
  shown_ = {};
  if (under_way_) worker_.cancel();
  under_way_.reset();
}

SliceImage SliceViews::sample(const Job& job, const CancelFlag& cancel) const {
  const SliceFrame& frame = job.wanted.frame;
  const double pixels = job.divisor;
  PlaneSampling sampling;
  sampling.width = std::max(2, (job.wanted.width + job.divisor - 1) / job.divisor);
  sampling.height = std::max(2, (job.wanted.height + job.divisor - 1) / job.divisor);
  IndexPlane plane;
  plane.corner = frame.indexAt(glm::dvec2(0.5 * pixels)) / step_;
  plane.across = frame.right * (pixels * (sampling.width - 1)) / step_;
  plane.along = frame.down * (pixels * (sampling.height - 1)) / step_;
  const double voxels = std::max(glm::length(frame.right), glm::length(frame.down)) * pixels;
  sampling.level = levelFor(pyramid_->lattice(), voxels / step_);
  return samplePlane(*pyramid_, plane, sampling, cancel);
}

bool SliceViews::isWanted(const Job& job) const {
  return wanted_[static_cast<std::size_t>(job.view)] == job.wanted;
}

// The quick ones first, and of these the one that waited longest.
std::optional<SliceViews::Job> SliceViews::nextJob() const {
  std::optional<Job> next;
  std::pair<bool, std::uint64_t> next_rank;
  for (int view = 0; view < kSliceViews; ++view) {
    const auto slot = static_cast<std::size_t>(view);
    const std::optional<Wanted>& wanted = wanted_[slot];
    if (!wanted || wanted->width < 1 || wanted->height < 1) continue;
    const bool has_one = done_[slot] && isWanted(*done_[slot]);
    if (has_one && done_[slot]->divisor == 1) continue;
    const std::pair rank(has_one, turns_[slot]);
    if (next && rank >= next_rank) continue;
    next = Job{view, *wanted, has_one ? 1 : quickDivisor(wanted->width, wanted->height)};
    next_rank = rank;
  }
  return next;
}

void SliceViews::update() {
  if (auto outcome = worker_.poll()) {
    Job& job = outcome->request;
    const auto slot = static_cast<std::size_t>(job.view);
    under_way_.reset();
    error_ = outcome->error;
    if (outcome->result)
      shown_[slot] = Shown{job.wanted.frame, std::move(*outcome->result),
                           static_cast<double>(job.divisor), nextNumber()};
    else
      job.divisor = 1;  // it is not tried again
    done_[slot] = std::move(job);
  }
  const bool is_fine = under_way_ && under_way_->divisor == 1 &&
                       quickDivisor(under_way_->wanted.width, under_way_->wanted.height) > 1;
  if (is_fine && !isWanted(*under_way_)) {
    worker_.cancel();
    under_way_.reset();
  }
  if (under_way_) return;
  auto job = nextJob();
  if (!job) return;
  turns_[static_cast<std::size_t>(job->view)] = ++last_turn_;
  under_way_ = job;
  worker_.request(std::move(*job));
}

}  // namespace isobrick
