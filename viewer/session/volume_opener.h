// From a path that the user names to a pyramid: opened, or built first, in the background.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "isobrick/storage/error.h"
#include "isobrick/storage/grid.h"
#include "isobrick/storage/pyramid.h"
#include "isobrick/viewer/stream/latest_worker.h"
#include "isobrick/viewer/stream/value_histogram.h"

namespace isobrick {

// The preview has every `step`-th voxel along each axis, from the first one on, and perhaps not all
// slices of them, at the volume's place in the world.
struct PreviewOf {
  std::int64_t step = 2;  // a power of two
  Index3 voxels{2};       // of the volume
};

struct BuildListener {
  // The phase ("bricks"), and the share of it that is done, 0 .. 1.
  std::function<void(std::string_view phase, double share)> progress;
  // A pyramid of the slices read so far; the file may be removed, and is not needed when this
  // returns.
  std::function<void(const std::string& path, const PreviewOf&)> preview;
  // The input holds several volumes, a line each, and none is chosen, as `refusal` says: waits for
  // the user and returns the number of one. Throws Cancelled.
  std::function<std::size_t(const std::string& refusal, const std::vector<std::string>& volumes)>
      choose;
};
// Makes a pyramid of a volume, unless there is a current one, and returns its path. Throws Error
// for a path that is no volume, and Cancelled.
using VolumeBuilder =
    std::function<std::string(const std::string& input, const BuildListener&, const CancelFlag&)>;

struct OpenedVolume {
  std::string source;   // as the user named it
  std::string pyramid;  // the file; the same, or the one built from it; a preview has none
  std::optional<PreviewOf> preview_of;  // if it is one, of the build under way
  std::shared_ptr<const Pyramid> file;
  ValueHistogram histogram;
  std::optional<int> step = {};  // its number, if it is one of several in time
};

// Opens without building; reads the histogram. `remote` is for a URL. Throws Error, and Cancelled
// soon after `cancel`, which may be null, even while a server is waited for.
OpenedVolume openPyramid(const std::string& path, std::uint64_t memory_bytes,
                         const RemoteOptions& remote = {}, const CancelFlag* cancel = nullptr,
                         FileAccess access = FileAccess::kMap);

// One opening at a time: a newer one ends the one before. All members are for one thread and never
// wait, but the destructor waits for the end of a build.
class VolumeOpener {
 public:
  // An opening that ended: a volume, or the reason for none.
  struct Outcome {
    std::string source;
    std::optional<OpenedVolume> volume;
    std::string error;
  };
  struct Status {
    bool busy = false;
    std::string source;                     // the path that is being opened
    std::string phase;                      // of its build; empty: it is only opened
    double share = 0.0;                     // of the phase
    std::vector<std::string> choices = {};  // volumes in it that wait for choose(), a line each
    std::string refusal = {};               // why the opening ends without a choice
  };

  // `build` is called on a thread of the opener.
  VolumeOpener(VolumeBuilder build, std::uint64_t memory_bytes, const RemoteOptions& remote = {});

  // A path, or another name that `build` takes.
  void open(const std::string& source);
  void cancel();
  void choose(std::size_t number);  // one of Status::choices
  std::optional<Outcome> poll();    // each once
  // The last preview of the volume that is being opened, once.
  std::optional<OpenedVolume> takePreview();
  Status status() const;

 private:
  OpenedVolume work(const std::string& source, const CancelFlag& cancel);
  std::size_t waitForChoice(const std::string& refusal, const std::vector<std::string>& choices,
                            const CancelFlag& cancel);
  void takeIn(const std::string& path, const PreviewOf& preview_of, const std::string& source,
              const CancelFlag& cancel);

  const VolumeBuilder build_;
  const std::uint64_t memory_bytes_;
  const RemoteOptions remote_;
  mutable std::mutex mutex_;  // guards the next three
  Status progress_;
  std::optional<OpenedVolume> preview_;
  std::optional<std::size_t> chosen_;
  LatestWorker<std::string, OpenedVolume> worker_;  // last: its thread uses the above
};

}  // namespace isobrick
