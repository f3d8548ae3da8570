// The plan by which a build keeps within its memory.
#pragma once

#include <cstdint>
#include <vector>

#include "isobrick/preprocess/build_region.h"
#include "isobrick/preprocess/scratch_volume.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/pyramid_info.h"

namespace isobrick {

// Windows and batches of encoded bricks that are under way at a time: one is filled while the
// other is emptied.
inline constexpr std::uint64_t kBuildWindows = 2;

struct BuildPlan {
  // Bricks of a window along x and y, for every level; of those below the region's, nothing.
  struct WindowShape {
    std::int64_t x = 1, y = 1;
  };
  std::vector<WindowShape> windows;
  // Samples of the largest window, as BrickNeeds gives them.
  std::uint64_t window_bytes = 0;
  std::uint64_t handed_on_bytes = 0;  // samples that it passes on to the next level

  // Slices between a source that is read in order and its use; 0 if it is read box by box.
  std::int64_t spool_slices = 0;
  ScratchVolume::Place spool_place = ScratchVolume::Place::kMemory;
  // The places in which the samples of level l, and the ranges of the tiles of level l - 1, wait.
  std::vector<ScratchVolume::Place> stores;

  std::uint64_t scratch_file_bytes = 0;  // the most that temporary files take at a time
  std::uint64_t file_bytes_bound = 0;    // the pyramid is at most so large
};

// `source` has the voxels of level 0; null if the region begins above it. Throws Error if
// `memory_bytes` does not suffice for one brick at a time; the message says how
// many bytes would.
BuildPlan makeBuildPlan(const PyramidSpec& spec, const BuildRegion& region,
                        const VolumeSource* source, std::uint64_t memory_bytes, int threads);

}  // namespace isobrick
