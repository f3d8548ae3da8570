#include "isobrick/viewer/session/plane_set.h"

#include <algorithm>
#include <utility>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/clock_seconds.h"

namespace isobrick {
namespace {

// To a side, of a sampling for a plane that may be moving: some milliseconds.
constexpr int kQuickValues = 512;

int valuesOf(const PlaneSampling& sampling) { return sampling.width + sampling.height; }

IndexPlane inSamples(const IndexPlane& plane, double step) {
  return {plane.corner / step, plane.across / step, plane.along / step};
}

}  // namespace

PlaneSet::PlaneSet(std::shared_ptr<const Pyramid> pyramid, double step)
    : pyramid_(std::move(pyramid)),
      step_(step),
      worker_([this](const Job& job, const CancelFlag& cancel) {
        return samplePlane(*pyramid_, inSamples(job.plane, step_), job.sampling, cancel);
      }) {}

void PlaneSet::update(SliceStore& store, const std::vector<WantedPlane>& wanted,
                      UploadAllowance& allowance) {
  wanted_ = wanted;
  for (WantedPlane& plane : wanted_)
    plane.most_values = std::min(plane.most_values, store.greatestSlice());
  dropOthers(store);
  if (auto outcome = worker_.poll()) {
    under_way_.reset();
    if (outcome->result) {
      begin(store, outcome->request, std::move(*outcome->result));
    } else {
      failed_[outcome->request.slot] = outcome->request.plane;
      error_ = outcome->error;
    }
  }
  // A fine sampling that is of no use any longer takes too long to wait for.
  if (under_way_ && !isOfUse(*under_way_) &&
      std::max(under_way_->sampling.width, under_way_->sampling.height) > kQuickValues) {
    worker_.cancel();
    under_way_.reset();
  }
  if (uploading_) uploadRows(store, allowance);
  if (uploading_ || worker_.busy()) return;
  if (auto job = nextJob()) {
    turns_[job->slot] = ++last_turn_;
    under_way_ = job;
    worker_.request(std::move(*job));
  }
}

PlaneSampling PlaneSet::samplingFor(const IndexPlane& plane, int most) const {
  return samplingOf(pyramid_->lattice(), inSamples(plane, step_), most);
}

const WantedPlane* PlaneSet::wantedOf(int slot) const {
  const auto found = std::find_if(wanted_.begin(), wanted_.end(),
                                  [&](const WantedPlane& plane) { return plane.slot == slot; });
  return found == wanted_.end() ? nullptr : &*found;
}

// A slice shows where it is, so one on the way is of use; a fine one takes too long for that.
bool PlaneSet::isOfUse(const Job& job) const {
  const WantedPlane* const wanted = wantedOf(job.slot);
  const bool is_quick = std::max(job.sampling.width, job.sampling.height) <= kQuickValues;
  return wanted != nullptr && (wanted->plane == job.plane || (wanted->cap_of < 0 && is_quick));
}

// The quick ones first, and of these the one that waited longest.
std::optional<PlaneSet::Job> PlaneSet::nextJob() const {
  std::optional<Job> next;
  std::pair<bool, std::uint64_t> next_rank;
  for (const WantedPlane& wanted : wanted_) {
    const auto failed = failed_.find(wanted.slot);
    if (failed != failed_.end() && failed->second == wanted.plane) continue;
    const auto kept = kept_.find(wanted.slot);
    const bool is_fine = kept != kept_.end() && kept->second.plane == wanted.plane;
    const PlaneSampling sampling = samplingFor(
        wanted.plane, is_fine ? wanted.most_values : std::min(kQuickValues, wanted.most_values));
    if (is_fine && valuesOf(sampling) <= kept->second.values) continue;
    const auto turn = turns_.find(wanted.slot);
    const std::pair rank(is_fine, turn == turns_.end() ? 0 : turn->second);
    if (next && rank >= next_rank) continue;
    next = Job{wanted.slot, wanted.plane, sampling};
    next_rank = rank;
  }
  return next;
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
    uploading_ = Upload{std::move(job), std::move(image), id, 0};
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
  under_way_.reset();
  worker_.cancel();
}

}  // namespace isobrick
