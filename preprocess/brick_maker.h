// Makes everything from one brick's samples: its stored parts, and the input of coarser levels.
#pragma once

#include "isobrick/preprocess/brick_closures.h"
#include "isobrick/preprocess/brick_window.h"
#include "isobrick/preprocess/kernels/sample_block.h"
#include "isobrick/preprocess/kernels/tile_ranges.h"
#include "isobrick/preprocess/phase_times.h"
#include "isobrick/preprocess/scratch_volume.h"
#include "isobrick/preprocess/voxel_statistics.h"
#include "isobrick/storage/brick_encoder.h"
#include "isobrick/storage/pyramid_writer.h"

namespace isobrick {

// The samples and ranges that bricks of a level pass on to the next one.
template <typename T>
struct HandedOn {
  T* samples = nullptr;            // of level + 1, dense in `box`; null at the top
  IndexBox box;                    // BrickNeeds::handedOn of a window
  ScratchVolume* tiles = nullptr;  // (min, max) of the level's tiles, x twice as wide; or null
};

// Makes the bricks of one pyramid; the same for all its levels. T is the voxel type. All members
// are thread-safe for different bricks of one level.
template <typename T>
class BrickMaker {
 public:
  // `needs`, `closures`, `statistics` and `times` outlive the maker.
  BrickMaker(const PyramidSpec& spec, format::Codec codec, const BrickNeeds& needs,
             BrickClosures& closures, VoxelStatistics& statistics, PhaseTimes& times)
      : spec_(spec),
        codec_(codec),
        needs_(needs),
        closures_(closures),
        statistics_(statistics),
        times_(times) {}

  // Encodes the brick and passes its samples and ranges on. `samples` holds needs.samples() of it;
  // `finer_tiles` are the tiles that the level below passed on, null at level 0. Returns the range
  // of the brick's samples at level 0, an empty one at others.
  ValueRange make(int level, const Index3& brick, const SampleBlock<T>& samples,
                  const ScratchVolume* finer_tiles, const HandedOn<T>& handed_on,
                  EncodedBrick& encoded) const;

  // Passes the samples `coarse` of level + 1 on alone, from samples of `level`; none of no size.
  void passOn(int level, const IndexBox& coarse, const SampleBlock<T>& samples,
              const HandedOn<T>& handed_on) const;

  // Passes on and returns the same as make(), from the parts of a brick that an earlier build
  // wrote.
  ValueRange remake(int level, const Index3& brick, const PyramidWriter& writer,
                    const HandedOn<T>& handed_on) const;

 private:
  struct Scratch;
  static Scratch& scratch();
  void count(const Index3& brick, const SampleBlock<T>& voxels) const;
  void includeFinerTiles(int level, const Index3& brick, const ScratchVolume& finer_tiles,
                         Scratch& s) const;
  void handOnTiles(int level, const Index3& brick, const HandedOn<T>& handed_on,
                   const std::vector<T>& pairs) const;

  const PyramidSpec spec_;
  const format::Codec codec_;
  const BrickNeeds& needs_;
  BrickClosures& closures_;
  VoxelStatistics& statistics_;
  PhaseTimes& times_;
};

}  // namespace isobrick
