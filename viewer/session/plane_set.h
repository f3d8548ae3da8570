// The slices and caps of a view, and the flat views of slices: sampled beside the interface.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/storage/pyramid.h"
#include "isobrick/viewer/session/scene_of_view.h"
#include "isobrick/viewer/state/slice_view.h"
#include "isobrick/viewer/stream/chunk_store.h"
#include "isobrick/viewer/stream/latest_worker.h"
#include "isobrick/viewer/stream/plane_sampler.h"
#include "isobrick/viewer/stream/surface_set.h"

namespace isobrick {

// Samples planes of a pyramid on a thread of its own, one at a time: the quick samplings first, and
// of these that of the slot that waited longest. A quick one is never given up, so what is dragged
// follows at its own pace; one that is slow is, if it is of no use any longer. Used by one thread.
class SamplingQueue {
 public:
  struct Job {
    int slot = 0;      // the same plane has the same number, wherever it is moved
    IndexPlane plane;  // voxels of the volume
    PlaneSampling sampling;
    bool is_finer = false;  // than what is there already: when nothing else is to do
    bool is_slow = false;
  };
  using Outcome = LatestWorker<Job, SliceImage>::Outcome;

  // `step`: voxels of the volume to a sample of the pyramid's level 0 (1, but for a preview).
  SamplingQueue(std::shared_ptr<const Pyramid> pyramid, double step);

  // The level whose samples are at most `most` to the longer side of a plane in voxels.
  PlaneSampling samplingOf(const IndexPlane& plane, int most) const;
  // The coarsest level with a sample or more to so many voxels.
  int levelFor(double voxels) const;

  // What has ended since; once.
  std::optional<Outcome> poll();
  // Gives up what is under way if it is slow, and `isOfUse` says no.
  template <typename F>
  void drop(F&& isOfUse) {
    if (under_way_ && under_way_->is_slow && !isOfUse(*under_way_)) cancel();
  }
  // Begins one of these, if nothing is under way; returns it.
  std::optional<Job> begin(const std::vector<Job>& jobs);
  void cancel();
  bool busy() const { return worker_.busy(); }

 private:
  const std::shared_ptr<const Pyramid> pyramid_;
  const double step_;
  std::map<int, std::uint64_t> turns_;  // when a slot was last sampled
  std::uint64_t last_turn_ = 0;
  std::optional<Job> under_way_;
  LatestWorker<Job, SliceImage> worker_;  // last: its thread uses the above
};

// Slices and caps are sampled quickly at first, with as many values as a picture can show when
// nothing else is to do. An unchanged plane keeps its image. A cap that has moved has none until
// its next sampling is done, as the old one would lie beside the cut.
//
// Used by the renderer's thread. release() comes before the renderer or this ends.
class PlaneSet {
 public:
  PlaneSet(std::shared_ptr<const Pyramid> pyramid, double step)
      : queue_(std::move(pyramid), step) {}

  // For each frame: the planes of the view. Uploads within `allowance`.
  void update(SliceStore& store, const std::vector<WantedPlane>& wanted,
              UploadAllowance& allowance);
  // The image for a plane, and the place that it was sampled at: for a slice that is dragged an
  // earlier one. None yet, or none any longer.
  struct Shown {
    IndexPlane plane;
    SliceId image = 0;
  };
  std::optional<Shown> shown(const WantedPlane& wanted) const;

  // Gives back all that the renderer keeps, and ends the work under way.
  void release(SliceStore& store);
  // False once every plane is shown as finely as it will be.
  bool busy() const { return uploading_ || queue_.busy() || !jobs().empty(); }
  // Of the last sampling or upload; empty: it went well.
  const std::string& error() const { return error_; }

 private:
  using Job = SamplingQueue::Job;
  struct Kept {
    IndexPlane plane;
    int values = 0;  // across and along
    SliceId image = 0;
  };
  struct Upload {
    Job job;
    SliceImage image;
    SliceId id = 0;
    int rows = 0;  // that were uploaded
  };
  const WantedPlane* wantedOf(int slot) const;
  bool isOfUse(const Job& job) const;
  std::vector<Job> jobs() const;
  void dropOthers(SliceStore& store);
  void begin(SliceStore& store, Job job, SliceImage image);
  void uploadRows(SliceStore& store, UploadAllowance& allowance);

  std::vector<WantedPlane> wanted_;
  std::map<int, Kept> kept_;          // by slot
  std::map<int, IndexPlane> failed_;  // not asked for again
  std::optional<Upload> uploading_;
  std::string error_;
  SamplingQueue queue_;
};

// The values of the flat views of the slices, a pixel each; of a view with many pixels coarser ones
// come first. Used by one thread.
//
// Numbers of samplings are those of the process, so that no view of another volume has the same.
class SliceViews {
 public:
  SliceViews(std::shared_ptr<const Pyramid> pyramid, double step)
      : queue_(std::move(pyramid), step) {}

  // The picture of this view is that of `frame`, which has `width` x `height` pixels.
  void want(int view, const SliceFrame& frame, int width, int height);
  // None of the views is to be seen.
  void forget();
  // For each frame of the window: takes what was sampled, and begins the next one.
  void update();

  // What was sampled last for a view; of an earlier frame while the wanted one is under way.
  struct Shown {
    SliceFrame frame;
    SliceImage values;  // a pixel each, or one for `pixels` x `pixels` of them
    double pixels = 1.0;
    std::uint64_t number = 0;  // none is given twice
    // The value at a pixel of the picture, trilinear between voxels; none outside of the volume.
    std::optional<double> valueAt(const glm::dvec2& pixel) const;
  };
  const std::optional<Shown>& shown(int view) const {
    return shown_[static_cast<std::size_t>(view)];
  }
  // False once every view is shown as finely as it will be.
  bool busy() const { return queue_.busy() || !jobs().empty(); }
  // Of the last sampling; empty: it went well.
  const std::string& error() const { return error_; }

 private:
  struct Wanted {
    SliceFrame frame;
    int width = 0, height = 0;

    bool operator==(const Wanted&) const = default;
  };
  struct Sampled {
    Wanted wanted;
    int divisor = 1;  // pixels to a value, to each side
  };
  std::vector<SamplingQueue::Job> jobs() const;

  std::array<std::optional<Wanted>, kSliceViews> wanted_;
  std::array<std::optional<Sampled>, kSliceViews> done_;  // or failed, and not to be done again
  std::array<Sampled, kSliceViews> asked_;                // that are, or were, under way
  std::array<std::optional<Shown>, kSliceViews> shown_;
  std::string error_;
  SamplingQueue queue_;
};

}  // namespace isobrick
