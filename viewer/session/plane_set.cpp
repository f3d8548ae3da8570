#include "isobrick/viewer/session/plane_set.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <glm/geometric.hpp>
#include <utility>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/stream/latest_worker.h"

namespace isobrick {
namespace {

IndexPlane inSamples(const IndexPlane& plane, double step) {
  return {plane.corner / step, plane.across / step, plane.along / step};
}

// To a side, of a sampling for a plane that may be moving: some milliseconds.
constexpr int kQuickValues = 512;

// Of a sampling for a flat view that may be moving: some 10 ms.
constexpr double kQuickPixels = 250'000.0;

int quickDivisor(int width, int height) {
  return std::max(
      1, static_cast<int>(std::ceil(
             std::sqrt(static_cast<double>(width) * static_cast<double>(height) / kQuickPixels))));
}

std::uint64_t nextNumber() {
  static std::atomic<std::uint64_t> last{0};
  return ++last;
}

}  // namespace

// -------------------------------------------------------------------------------- one at a time

SamplingQueue::SamplingQueue(std::shared_ptr<const Pyramid> pyramid, double step)
    : pyramid_(std::move(pyramid)),
      step_(step),
      worker_([this](const Job& job, const CancelFlag& cancel) {
        return samplePlane(*pyramid_, inSamples(job.plane, step_), job.sampling, cancel);
      }) {}

PlaneSampling SamplingQueue::samplingOf(const IndexPlane& plane, int most) const {
  return isobrick::samplingOf(pyramid_->lattice(), inSamples(plane, step_), most);
}

int SamplingQueue::levelFor(double voxels) const {
  const int last = pyramid_->lattice().levels() - 1;
  int level = 0;
  while (level < last && std::ldexp(1.0, level + 1) <= voxels / step_) ++level;
  return level;
}

std::optional<SamplingQueue::Outcome> SamplingQueue::poll() {
  auto outcome = worker_.poll();
  if (outcome) under_way_.reset();
  return outcome;
}

std::optional<SamplingQueue::Job> SamplingQueue::begin(const std::vector<Job>& jobs) {
  if (jobs.empty() || worker_.busy()) return std::nullopt;
  const auto rank = [&](const Job& job) {
    const auto turn = turns_.find(job.slot);
    return std::pair(job.is_finer, turn == turns_.end() ? 0 : turn->second);
  };
  const Job& next = *std::ranges::min_element(jobs, {}, rank);
  turns_[next.slot] = ++last_turn_;
  under_way_ = next;
  worker_.request(next);
  return next;
}

void SamplingQueue::cancel() {
  worker_.cancel();
  under_way_.reset();
}

// ------------------------------------------------------------------------------ slices and caps

void PlaneSet::update(SliceStore& store, const std::vector<WantedPlane>& wanted,
                      UploadAllowance& allowance) {
  wanted_ = wanted;
  for (WantedPlane& plane : wanted_)
    plane.most_values = std::min(plane.most_values, store.greatestSlice());
  dropOthers(store);
  if (auto outcome = queue_.poll()) {
    if (outcome->result) {
      begin(store, outcome->request, std::move(*outcome->result));
    } else {
      failed_[outcome->request.slot] = outcome->request.plane;
      error_ = outcome->error;
    }
  }
  queue_.drop([&](const Job& job) { return isOfUse(job); });
  if (uploading_) uploadRows(store, allowance);
  if (!uploading_) queue_.begin(jobs());
}

const WantedPlane* PlaneSet::wantedOf(int slot) const {
  const auto found = std::find_if(wanted_.begin(), wanted_.end(),
                                  [&](const WantedPlane& plane) { return plane.slot == slot; });
  return found == wanted_.end() ? nullptr : &*found;
}

// A slice shows where it is, so one on the way is of use; a fine one takes too long for that.
bool PlaneSet::isOfUse(const Job& job) const {
  const WantedPlane* const wanted = wantedOf(job.slot);
  return wanted != nullptr && (wanted->plane == job.plane || (wanted->cap_of < 0 && !job.is_slow));
}

std::vector<SamplingQueue::Job> PlaneSet::jobs() const {
  std::vector<Job> jobs;
  for (const WantedPlane& wanted : wanted_) {
    const auto failed = failed_.find(wanted.slot);
    if (failed != failed_.end() && failed->second == wanted.plane) continue;
    const auto kept = kept_.find(wanted.slot);
    const bool is_there = kept != kept_.end() && kept->second.plane == wanted.plane;
    const int most = is_there ? wanted.most_values : std::min(kQuickValues, wanted.most_values);
    const PlaneSampling sampling = queue_.samplingOf(wanted.plane, most);
    if (is_there && sampling.width + sampling.height <= kept->second.values) continue;
    const bool is_slow = std::max(sampling.width, sampling.height) > kQuickValues;
    jobs.push_back({wanted.slot, wanted.plane, sampling, is_there, is_slow});
  }
  return jobs;
}

void PlaneSet::dropOthers(SliceStore& store) {
  std::erase_if(kept_, [&](const auto& entry) {
    const WantedPlane* const wanted = wantedOf(entry.first);
    if (wanted != nullptr && (wanted->cap_of < 0 || wanted->plane == entry.second.plane))
      return false;
    store.releaseSlice(entry.second.image);
    return true;
  });
  std::erase_if(failed_, [&](const auto& entry) {
    const WantedPlane* const wanted = wantedOf(entry.first);
    return wanted == nullptr || wanted->plane != entry.second;
  });
  if (uploading_ && !isOfUse(uploading_->job)) {
    store.releaseSlice(uploading_->id);
    uploading_.reset();
  }
}

void PlaneSet::begin(SliceStore& store, Job job, SliceImage image) {
  if (!isOfUse(job)) return;
  try {
    const SliceId id = store.reserveSlice(image.width, image.height);
    uploading_ = Upload{job, std::move(image), id, 0};
    error_.clear();
  } catch (const RendererLost&) {
    throw;
  } catch (const Error& error) {
    failed_[job.slot] = job.plane;
    error_ = error.what();
  }
}

// At least one piece if the time is spent, so that a slow machine comes to an end too.
void PlaneSet::uploadRows(SliceStore& store, UploadAllowance& allowance) {
  Upload& upload = *uploading_;
  const std::uint64_t row = sizeof(float) * static_cast<std::uint64_t>(upload.image.width);
  while (upload.rows < upload.image.height) {
    const std::uint64_t room = std::min<std::uint64_t>(kPieceBytes, allowance.bytes) / row;
    const int rows = static_cast<int>(
        std::min(room, static_cast<std::uint64_t>(upload.image.height - upload.rows)));
    if (rows == 0) return;
    const double begin = clockSeconds();
    store.uploadRows(upload.id, upload.image, upload.rows, rows);
    upload.rows += rows;
    allowance.take(row * static_cast<std::uint64_t>(rows), clockSeconds() - begin);
    if (allowance.isSpent()) break;
  }
  if (upload.rows < upload.image.height) return;
  const auto before = kept_.find(upload.job.slot);
  if (before != kept_.end()) store.releaseSlice(before->second.image);
  kept_[upload.job.slot] = {upload.job.plane, upload.image.width + upload.image.height, upload.id};
  uploading_.reset();
}

std::optional<PlaneSet::Shown> PlaneSet::shown(const WantedPlane& wanted) const {
  const auto found = kept_.find(wanted.slot);
  if (found == kept_.end()) return std::nullopt;
  if (wanted.cap_of >= 0 && wanted.plane != found->second.plane) return std::nullopt;
  return Shown{found->second.plane, found->second.image};
}

void PlaneSet::release(SliceStore& store) {
  for (const auto& [slot, kept] : kept_) store.releaseSlice(kept.image);
  if (uploading_) store.releaseSlice(uploading_->id);
  kept_.clear();
  failed_.clear();
  uploading_.reset();
  queue_.cancel();
}

// ------------------------------------------------------------------------------------ flat views

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

void SliceViews::want(int view, const SliceFrame& frame, int width, int height) {
  wanted_[static_cast<std::size_t>(view)] = Wanted{frame, width, height};
}

void SliceViews::forget() {
  wanted_ = {};
  done_ = {};
  shown_ = {};
  queue_.cancel();
}

std::vector<SamplingQueue::Job> SliceViews::jobs() const {
  std::vector<SamplingQueue::Job> jobs;
  for (std::size_t view = 0; view < kSliceViews; ++view) {
    if (!wanted_[view] || wanted_[view]->width < 1 || wanted_[view]->height < 1) continue;
    const auto& [frame, width, height] = *wanted_[view];
    const bool is_there = done_[view] && done_[view]->wanted == *wanted_[view];
    if (is_there && done_[view]->divisor == 1) continue;
    const int divisor = is_there ? 1 : quickDivisor(width, height);
    const double pixels = divisor;
    PlaneSampling sampling;
    sampling.width = std::max(2, (width + divisor - 1) / divisor);
    sampling.height = std::max(2, (height + divisor - 1) / divisor);
    sampling.level =
        queue_.levelFor(std::max(glm::length(frame.right), glm::length(frame.down)) * pixels);
    const IndexPlane plane{frame.indexAt(glm::dvec2(0.5 * pixels)),
                           frame.right * (pixels * (sampling.width - 1)),
                           frame.down * (pixels * (sampling.height - 1))};
    jobs.push_back({static_cast<int>(view), plane, sampling, is_there,
                    divisor == 1 && quickDivisor(width, height) > 1});
  }
  return jobs;
}

void SliceViews::update() {
  const auto viewOf = [](const SamplingQueue::Job& job) {
    return static_cast<std::size_t>(job.slot);
  };
  if (auto outcome = queue_.poll()) {
    const std::size_t view = viewOf(outcome->request);
    Sampled sampled = asked_[view];
    error_ = outcome->error;
    if (outcome->result)
      shown_[view] = Shown{sampled.wanted.frame, std::move(*outcome->result),
                           static_cast<double>(sampled.divisor), nextNumber()};
    else
      sampled.divisor = 1;  // it is not tried again
    done_[view] = sampled;
  }
  queue_.drop([&](const SamplingQueue::Job& job) {
    return wanted_[viewOf(job)] == asked_[viewOf(job)].wanted;
  });
  const auto begun = queue_.begin(jobs());
  if (!begun) return;
  const Wanted& wanted = *wanted_[viewOf(*begun)];
  asked_[viewOf(*begun)] = {wanted,
                            begun->is_finer ? 1 : quickDivisor(wanted.width, wanted.height)};
}

}  // namespace isobrick
