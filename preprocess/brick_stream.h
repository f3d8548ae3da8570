// A volume without a pyramid, as bricks of level 0 in memory: one that is read once, from its first
// to its last slice, or an array.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>

#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/pyramid.h"

namespace isobrick {

// How a volume is read.
struct BrickStreamOptions {
  // Opens the volume anew, to be read from its beginning; the same each time.
  std::function<std::unique_ptr<VolumeSource>()> open;
  std::uint64_t memory_bytes = std::uint64_t{1} << 30;  // for voxels, and what the source holds
  const CancelFlag* cancel = nullptr;                   // may be null
  // Called now and then by one thread at a time while a pass before the first one looks for the
  // range of values: the share of it that is done, 0 .. 1. May be empty.
  std::function<void(double fraction)> progress;
};

// One volume; its bricks are at hand a window at a time. A window is a slab of bricks, or some rows
// of bricks if memory is short; the next one is read meanwhile if memory allows. Used by one thread
// at a time.
class BrickStream {
 public:
  // Opens the volume, and chooses its voxels (VolumeSource::chooseVoxels()). A volume of float32
  // that fits() is read once for the range of its values. Throws what that throws, and Error for
  // NaN and infinite voxels.
  explicit BrickStream(BrickStreamOptions options);
  ~BrickStream();
  BrickStream(const BrickStream&) = delete;
  BrickStream& operator=(const BrickStream&) = delete;

  // False if the memory does not suffice to run() through the volume; then nothing else may be
  // asked.
  bool fits() const;
  // What the volume says of itself.
  const VolumeInfo& info() const;
  // Level 0 alone, in bricks as a pyramid has them by default. Only bricks that are at hand may be
  // used: OnePassSurface does.
  const Pyramid& pyramid() const;

  // Reads the volume and calls `take` for one window of `bricks` after the other, in the order of
  // the brick table: these bricks are at hand until it returns. On the calling TBB arena. Once or
  // several times. Throws what the source throws, Error if a voxel is not finite or a file changed
  // meanwhile, Cancelled, and what `take` throws.
  void run(const IndexBox& bricks, const std::function<void(const IndexBox&)>& take);

  // The least and the greatest voxel of the volume, as stored. Reads it once for that, unless it
  // is float32. Throws what run() does.
  ValueRange range();

 private:
  class Run;
  template <typename T>
  class TypedRun;
  std::unique_ptr<Run> run_;
};

// Voxels where they lie: those of a row follow each other, rows and slices lie anywhere. Strides
// are in voxels and may be below 0.
struct VoxelArray {
  const void* first = nullptr;    // voxel (0, 0, 0); of the type of VolumeInfo, aligned for it
  std::int64_t row_stride = 0;    // from (x, y, z) to (x, y + 1, z)
  std::int64_t slice_stride = 0;  // from (x, y, z) to (x, y, z + 1)
};

// For queries of level 0, by Extractor: the mesh is that of a pyramid of the same volume. A query
// goes once through the bricks that it needs, and copies those that the surface crosses; of
// float32, this goes once through the array, on the calling TBB arena, for the range of its values.
// The array outlives the result, and does not change meanwhile. Throws Error for NaN and infinite
// voxels.
std::unique_ptr<const Pyramid> pyramidOfArray(const VolumeInfo& info, const VoxelArray& array);

}  // namespace isobrick
