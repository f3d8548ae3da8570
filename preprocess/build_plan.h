// The bricks that one build makes, and the plan by which it keeps within its memory.
#pragma once

#include <cstdint>
#include <vector>

#include "isobrick/preprocess/brick_window.h"
#include "isobrick/preprocess/scratch_volume.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/pyramid_division.h"
#include "isobrick/storage/pyramid_info.h"

namespace isobrick {

// A whole pyramid, one super-brick of a divided one, or the levels above all super-bricks.
//
// The region makes its own bricks of some levels, level by level, and passes samples on from each
// to the next. Bricks around a super-brick's own are read as far as its coarser levels take their
// samples, and are not made. Pure arithmetic.
class BuildRegion {
 public:
  // The bricks of a file of a divided pyramid; without one, the whole pyramid. The first input of
  // the index's comes from the super-bricks.
  explicit BuildRegion(const PyramidSpec& spec,
                       const std::optional<DividedFile>& file = std::nullopt);

  const BrickNeeds& needs() const { return needs_; }
  const BrickLayout& layout() const { return needs_.layout(); }
  // Its own bricks.
  const TableRows& rows() const { return rows_; }
  int firstLevel() const { return rows_.firstLevel(); }
  int endLevel() const { return rows_.endLevel(); }
  bool isOwn(int level, const Index3& brick) const { return contains(rows_.bricks(level), brick); }

  // The bricks that windows are cut from: its own, and those that pass samples on to them.
  const IndexBox& windowBricks(int level) const { return read_[place(level)]; }
  // Samples of level + 1, and tiles of `level`, that it passes on. Empty at the top of the pyramid.
  // For the level below its first one all that it takes.
  IndexBox passedSamples(int level) const;
  IndexBox passedTiles(int level) const;

  // The samples that a window of these bricks takes, and those that it passes on, which may be
  // none.
  IndexBox samples(int level, const IndexBox& bricks) const;
  IndexBox handedOn(int level, const IndexBox& bricks) const;

 private:
  std::size_t place(int level) const { return static_cast<std::size_t>(level - firstLevel()); }
  void passOn();

  PyramidSpec spec_;
  BrickNeeds needs_;
  TableRows rows_;
  std::vector<IndexBox> read_, passed_;  // for each of its levels
};

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
