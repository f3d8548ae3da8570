// The last pass of a build: bounds of the errors of coarser leaves (rule 15).
#pragma once

#include <deque>
#include <functional>

#include "isobrick/preprocess/error_chunk.h"
#include "isobrick/preprocess/phase_times.h"
#include "isobrick/preprocess/written_bricks.h"
#include "isobrick/storage/cancel.h"
#include "isobrick/storage/error_bins.h"
#include "isobrick/storage/pyramid_writer.h"
#include "isobrick/storage/voxel_histogram.h"

namespace isobrick {

// 32 bins of equal width between the values that all but a thousandth of the voxels at each end lie
// in: docs/ALGORITHM.md says why. `values`: of all voxels.
ErrorBins errorBinsOf(const VoxelHistogram& histogram, const ValueRange& values, int last_level);

// Reads the levels back from the temporary file, as a bound compares a coarse level with level 0,
// and which bins there are is known only after the last voxel. Works on one region after the other:
// a brick of the coarsest level that has bounds, and all that lies in it. T is the voxel type.
template <typename T>
class ErrorPass {
 public:
  // `writer` has all bricks, `times` takes the time; both outlive the pass. About `memory_bytes`
  // are used for what is read.
  ErrorPass(const PyramidSpec& spec, const ErrorBins& bins, const ValueRange& values,
            format::Codec codec, std::uint64_t memory_bytes, PyramidWriter& writer,
            PhaseTimes& times);

  // Finds the bounds of all bricks, with as many threads of the calling TBB arena as the memory is
  // for, and writes them. The bytes do not
  // depend on the number of threads or on memory_bytes. `cancel` may be null. `progress(share)` is
  // called by this thread. Throws Cancelled, and ResumableError where the disk fails.
  void run(const CancelFlag* cancel, const std::function<void(double)>& progress);

 private:
  struct BrickErrors;

  Index3 regions() const;
  std::deque<BrickErrors> bricksIn(const Index3& region) const;
  bool isConstant(const IndexBox& cells, const std::deque<BrickErrors>& bricks) const;
  void findChunk(const IndexBox& cells, std::deque<BrickErrors>& bricks);
  void includeCodes(const ErrorCodes& codes, BrickErrors& brick) const;
  void writeBricks(std::deque<BrickErrors>& bricks);

  const PyramidSpec spec_;
  const BrickLayout layout_;
  const ErrorBins bins_;
  const ValueRange values_;
  const format::Codec codec_;
  PyramidWriter& writer_;
  PhaseTimes& times_;
  const int threads_;
  WrittenBricks<T> written_;
  std::int64_t region_voxels_;
};

}  // namespace isobrick
