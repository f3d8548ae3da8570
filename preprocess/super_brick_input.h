// The volume that one process builds several super-bricks from.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "isobrick/preprocess/divided_pyramid.h"
#include "isobrick/preprocess/scratch_volume.h"

namespace isobrick {

// A volume that is read in order (VolumeSource::readsBoxes() is false) has its slices decoded once
// for all super-bricks that lie beside each other: they wait in a temporary file. If there is no
// room for it, each super-brick reads them anew. For one thread.
class SuperBrickInput {
 public:
  // `open` opens the volume, as often as it has to be read again. `folder` is for the temporary
  // file.
  SuperBrickInput(std::function<std::unique_ptr<VolumeSource>()> open, std::string folder);

  // What it says of itself. Valid until the next call of sourceOf().
  const VolumeSource& volume() const;

  // The source for buildSuperBrick() of next[0]. `next` are files that this process is going to
  // build, in the order of their numbers. Valid until the next call. `progress` (a share, 0 .. 1)
  // is told of slices that go into the temporary file; it may be empty, and `cancel` null. Throws
  // what `open` and the source throw, and Cancelled.
  VolumeSource& sourceOf(std::span<const SuperBrickFile> next, const CancelFlag* cancel,
                         const std::function<void(double)>& progress);

 private:
  bool hasRoomFor(std::int64_t slices) const;

  const std::function<std::unique_ptr<VolumeSource>()> open_;
  const std::string folder_;
  std::unique_ptr<VolumeSource> source_;    // null: all that is needed now is in scratch_
  std::unique_ptr<ScratchSource> scratch_;  // may be null
  bool is_read_ = false;                    // source_ was
  std::optional<VolumeInfo> chosen_;        // how numbers become voxels, once that is known
};

}  // namespace isobrick
