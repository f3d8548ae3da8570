// Makes everything from one brick's samples: its stored parts, and the input of coarser levels.
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "isobrick/preprocess/brick_window.h"
#include "isobrick/preprocess/kernels/sample_block.h"
#include "isobrick/preprocess/kernels/tile_ranges.h"
#include "isobrick/preprocess/scratch_volume.h"
#include "isobrick/preprocess/voxel_statistics.h"
#include "isobrick/storage/brick_encoder.h"
#include "isobrick/storage/brick_table.h"
#include "isobrick/storage/pyramid_writer.h"
#include "isobrick/storage/voxel_type.h"

namespace isobrick {

// A brick's range is a closure (rule 7): it includes the samples of its own level, of all finer
// ones, and of the coarser ones up to the level at which the brick is a single cell. The first two
// and the nearest coarser levels come with the ranges of its tiles, the others when those levels
// are made. Thread-safe for different bricks of one level.
class BrickClosures {
 public:
  // For these bricks, with empty ranges at first.
  BrickClosures(const BrickLayout& layout, const TableRows& rows, bool has_missing = false)
      : BrickClosures(layout, rows, std::vector<ValueRange>(rows.count())) {
    has_missing_ = has_missing;
  }
  // With ranges that are known.
  BrickClosures(const BrickLayout& layout, const TableRows& rows, std::vector<ValueRange> ranges)
      : layout_(layout), rows_(rows), ranges_(std::move(ranges)) {}

  // To be called once for each of these bricks, finest level first: `tiles` is the union of
  // the brick's tile ranges, `samples` holds the corners of its cells.
  template <typename T>
  void include(int level, const Index3& brick, const ValueRange& tiles,
               const SampleBlock<T>& samples);

  // The half of include() that concerns finer bricks: takes the samples into those of them that are
  // among these.
  template <typename T>
  void includeInFiner(int level, const Index3& brick, const SampleBlock<T>& samples);

  // In the order of the brick table; final when all bricks were included.
  std::span<const ValueRange> all() const { return ranges_; }
  // Row of a brick in that order.
  std::size_t row(int level, const Index3& brick) const { return rows_.row(level, brick); }

 private:
  BrickLayout layout_;
  TableRows rows_;
  std::vector<ValueRange> ranges_;
  bool has_missing_ = false;  // samples without data
};

enum class BuildStep { kRead, kLowPass, kRanges, kCount, kCurvature, kPack, kWrite, kPublish };
inline constexpr std::array<const char*, 8> kBuildStepNames = {
    "read", "low-pass", "ranges", "count", "curvature", "pack", "write", "publish"};

// Seconds that all threads together spent in each step. Thread-safe.
class PhaseTimes {
 public:
  using Clock = std::chrono::steady_clock;

  // Adds the time of its life to a step.
  class Timer {
   public:
    Timer(PhaseTimes& times, BuildStep step) : times_(times), step_(step) {}
    ~Timer() {
      times_.nanoseconds_[static_cast<std::size_t>(step_)].fetch_add(
          std::chrono::duration_cast<std::chrono::nanoseconds>(Clock::now() - begin_).count(),
          std::memory_order_relaxed);
    }
    Timer(const Timer&) = delete;
    Timer& operator=(const Timer&) = delete;

   private:
    PhaseTimes& times_;
    BuildStep step_;
    Clock::time_point begin_ = Clock::now();
  };

  double seconds(BuildStep step) const {
    return static_cast<double>(nanoseconds_[static_cast<std::size_t>(step)].load()) * 1e-9;
  }

 private:
  std::array<std::atomic<std::int64_t>, kBuildStepNames.size()> nanoseconds_{};
};

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
