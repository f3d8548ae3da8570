// The slices and caps of a view: sampled beside the interface, and kept by the store.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/storage/pyramid.h"
#include "isobrick/viewer/session/scene_of_view.h"
#include "isobrick/viewer/stream/latest_worker.h"
#include "isobrick/viewer/stream/plane_sampler.h"
#include "isobrick/viewer/stream/slice_store.h"
#include "isobrick/viewer/stream/surface_set.h"

namespace isobrick {

// One plane is sampled at a time, quickly at first, with as many values as a picture can show when
// nothing else is to do. A quick sampling is never given up: a slice that is dragged follows at its
// own pace. An unchanged plane keeps its image. A cap that has moved has none until its next
// sampling is done, as the old one would lie beside the cut.
//
// Used by the renderer's thread. release() comes before the renderer or this ends.
class PlaneSet {
 public:
  // `step`: voxels of the volume to a sample of the pyramid's level 0 (1, but for a preview).
  PlaneSet(std::shared_ptr<const Pyramid> pyramid, double step);

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
  bool busy() const { return uploading_ || worker_.busy() || nextJob().has_value(); }
  // Of the last sampling or upload; empty: it went well.
  const std::string& error() const { return error_; }

 private:
  struct Job {
    int slot = 0;
    IndexPlane plane;  // voxels
    PlaneSampling sampling;
  };
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
  PlaneSampling samplingFor(const IndexPlane& plane, int most) const;
  const WantedPlane* wantedOf(int slot) const;
  bool isOfUse(const Job& job) const;
  std::optional<Job> nextJob() const;
  void dropOthers(SliceStore& store);
  void begin(SliceStore& store, Job job, SliceImage image);
  void uploadRows(SliceStore& store, UploadAllowance& allowance);

  const std::shared_ptr<const Pyramid> pyramid_;
  const double step_;
  std::vector<WantedPlane> wanted_;
  std::map<int, Kept> kept_;            // by slot
  std::map<int, IndexPlane> failed_;    // not asked for again
  std::map<int, std::uint64_t> turns_;  // when a slot was last sampled
  std::uint64_t last_turn_ = 0;
  std::optional<Job> under_way_;
  std::optional<Upload> uploading_;
  std::string error_;
  LatestWorker<Job, SliceImage> worker_;  // last: its thread uses the above
};

}  // namespace isobrick
