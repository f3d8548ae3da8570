// From a path that the user names to a pyramid: opened, or built first, in the background.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>

#include "isobrick/storage/error.h"
#include "isobrick/storage/grid.h"
#include "isobrick/storage/pyramid.h"
#include "isobrick/viewer/stream/latest_worker.h"
#include "isobrick/viewer/stream/value_histogram.h"

namespace isobrick {

// The preview has every `step`-th voxel along each axis, from the first one on, and perhaps not all
// slices of them, in the place of the world where the volume is.
struct PreviewOf {
  std::int64_t step = 2;  // a power of two
  Index3 voxels{2};       // of the volume
};

// The reports of a build under way.
struct BuildListener {
  // How far it is: the phase ("bricks"), and the share of it that is done, 0 .. 1.
  std::function<void(std::string_view phase, double share)> progress;
  // A pyramid of what was read by now; the file may be removed, and is not needed when this
  // returns.
  std::function<void(const std::string& path, const PreviewOf&)> preview;
};
// Makes a pyramid of a volume, unless there is a current one, and returns its path. Throws Error
// for what is no volume, and Cancelled.
using VolumeBuilder =
    std::function<std::string(const std::string& input, const BuildListener&, const CancelFlag&)>;

// A pyramid that is ready to be looked at.
struct OpenedVolume {
  std::string source;   // what was asked for
  std::string pyramid;  // the file; the same, or what was built of it; a preview's has none
  std::optional<PreviewOf> preview_of;  // where it is one, of what is being built
  std::shared_ptr<const Pyramid> file;
  ValueHistogram histogram;
};

// Opens without building; reads the histogram. `remote` is for a URL. Throws Error, and Cancelled
// soon after `cancel`, which may be null, even while a server is waited for.
OpenedVolume openPyramid(const std::string& path, std::uint64_t memory_bytes,
                         const RemoteOptions& remote = {}, const CancelFlag* cancel = nullptr);

// One opening at a time: a newer one ends the one before. All members are for one thread and never
// wait, but the destructor waits for the end of a build.
class VolumeOpener {
 public:
  // An opening that ended: a volume, or why there is none.
  struct Outcome {
    std::string source;
    std::optional<OpenedVolume> volume;
    std::string error;
  };
  struct Status {
    bool busy = false;
    std::string source;  // what is being opened
    std::string phase;   // of its build; empty: it is only opened
    double share = 0.0;  // of the phase
  };

  // `build` is called on a thread of the opener.
  VolumeOpener(VolumeBuilder build, std::uint64_t memory_bytes, const RemoteOptions& remote = {});

  // A path, or what else `build` knows.
  void open(const std::string& source);
  void cancel();
  std::optional<Outcome> poll();  // each once
  // The last preview of what is being opened, once.
  std::optional<OpenedVolume> takePreview();
  Status status() const;

 private:
  OpenedVolume work(const std::string& source, const CancelFlag& cancel);
  void takeIn(const std::string& path, const PreviewOf& preview_of, const std::string& source,
              const CancelFlag& cancel);

  const VolumeBuilder build_;
  const std::uint64_t memory_bytes_;
  const RemoteOptions remote_;
  mutable std::mutex mutex_;  // guards progress_ and preview_
  Status progress_;
  std::optional<OpenedVolume> preview_;
  LatestWorker<std::string, OpenedVolume> worker_;  // last: its thread uses the above
};

}  // namespace isobrick
