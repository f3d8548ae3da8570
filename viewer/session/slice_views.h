// The values of the flat views of the slices, sampled beside the interface.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "isobrick/storage/pyramid.h"
#include "isobrick/viewer/state/slice_view.h"
#include "isobrick/viewer/stream/latest_worker.h"
#include "isobrick/viewer/stream/plane_sampler.h"

namespace isobrick {

// One view is sampled at a time: the one that waited longest, coarsely at first if it has many
// pixels, and finely when nothing else is to do. No coarse sampling is given up, so a slice that
// is dragged follows at its own pace. Used by one thread.
//
// Numbers of samplings are those of the process, so that no view of another volume has the same.
class SliceViews {
 public:
  // `step`: voxels of the volume to a sample of the pyramid's level 0 (1, but for a preview).
  SliceViews(std::shared_ptr<const Pyramid> pyramid, double step);

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
  bool busy() const { return worker_.busy() || nextJob().has_value(); }
  // Of the last sampling; empty: it went well.
  const std::string& error() const { return error_; }

 private:
  struct Wanted {
    SliceFrame frame;
    int width = 0, height = 0;

    bool operator==(const Wanted&) const = default;
  };
  struct Job {
    int view = 0;
    Wanted wanted;
    int divisor = 1;  // pixels to a value, to each side
  };
  SliceImage sample(const Job& job, const CancelFlag& cancel) const;
  std::optional<Job> nextJob() const;
  bool isWanted(const Job& job) const;

  const std::shared_ptr<const Pyramid> pyramid_;
  const double step_;
  std::array<std::optional<Wanted>, kSliceViews> wanted_;
  std::array<std::optional<Job>, kSliceViews> done_;  // or failed, and not to be done again
  std::array<std::optional<Shown>, kSliceViews> shown_;
  std::array<std::uint64_t, kSliceViews> turns_{};  // when a view was last sampled
  std::uint64_t last_turn_ = 0;
  std::optional<Job> under_way_;
  std::string error_;
  LatestWorker<Job, SliceImage> worker_;  // last: its thread uses the above
};

}  // namespace isobrick
