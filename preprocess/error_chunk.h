// The stored error bounds (rule 15), as far as a box of voxels has a say in them.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <functional>
#include <vector>

#include "isobrick/preprocess/kernels/error_rows.h"
#include "isobrick/storage/brick_layout.h"
#include "isobrick/storage/error_bins.h"
#include "isobrick/storage/value_range.h"

namespace isobrick {

// A code (ErrorCode) for every cell of a box and every bin of a run of bins: bin by bin, in each x
// fastest. Other bins have the code 0 everywhere.
struct ErrorCodes {
  IndexBox cells;
  std::uint32_t first_bin = 0, bins = 0;
  std::vector<std::uint8_t> codes;
  std::vector<std::uint8_t> is_used;  // by bin of the run: 0 where all codes are

  // All codes 0.
  void reset(const IndexBox& box, std::uint32_t first, std::uint32_t count);
  bool isUsed(std::uint32_t bin) const {
    return bin >= first_bin && bin < first_bin + bins && is_used[bin - first_bin] != 0;
  }
  void use(std::uint32_t bin) { is_used[bin - first_bin] = 1; }
  std::uint8_t* bin(std::uint32_t i) { return codes.data() + offset(i); }
  const std::uint8_t* bin(std::uint32_t i) const { return codes.data() + offset(i); }

 private:
  std::size_t offset(std::uint32_t i) const {
    return (i - first_bin) * static_cast<std::size_t>(cells.size());
  }
};

// Finds them; keeps its memory from chunk to chunk. One object serves one thread.
//
// The error of a cell of level l for an isovalue v compares the field of a leaf with level 0 on all
// edges of level 0 in the closed cell. A corner of a leaf has the sample of level l, or that of
// level l - 1 where a finer leaf touches it; so `own` takes the field to lie anywhere between the
// interpolants of the lesser and the greater of both. `hanging` allows a corner beside a leaf of
// level l + 1 its mean of that leaf's corners too. With E(c, v) = 0 on level 0,
//
//   E(D, v) = max(own(D, v), max over the cells c of the next finer level that touch D of
//                            max(hanging(c, v), E(c, v))).
//
// So a leaf D whose E is within the tolerance touches only leaves and cells that are within it too:
// leaves are 2:1 balanced, and leaves beside D may hang on it. The bound of level 1 is that of the
// error that a query finds exactly (ErrorCells), or more.
class ErrorChunk {
 public:
  // Voxels around a cell that its error depends on, where bounds go up to a level.
  static constexpr std::int64_t marginOf(int last_level) { return std::int64_t{1} << last_level; }
  // A chunk begins at a multiple of that, and ends at one or at the end of the volume.
  static constexpr std::int64_t kAlignment = std::int64_t{1} << kMostErrorLevel;
  // Cells of level 0 that a chunk may have: longest along x, where the last voxel is a vector of
  // its own.
  static constexpr Index3 kMostCells{128 + 2 * kAlignment, 64 + 2 * kAlignment,
                                     32 + 2 * kAlignment};

  // Copies the samples in a box of a level, x fastest.
  using Read = std::function<void(int level, const IndexBox& box, float* out)>;

  // What the errors in a box of cells of level 0 say of the cells in it and of those that touch
  // them. `values`: of all voxels. Reads samples in the closed box alone.
  void find(const Lattice& lattice, const ErrorBins& bins, const ValueRange& values,
            const IndexBox& cells, const Read& read);

  // Of the cells of a level from kFirstErrorLevel to bins.last_level in the chunk and of a ring
  // around it. The bound of a cell, for all isovalues of a bin, is the greatest of its codes in all
  // chunks that come within marginOf(bins.last_level) voxels of it: together they look at every
  // error once, or at those on their common faces twice.
  const ErrorCodes& codes(int level) const { return found_[level - kFirstErrorLevel]; }

 private:
  enum class Corners { kOwn, kHanging };

  // Samples of a level, or one of their bounds, in `box`.
  struct Field {
    IndexBox box;
    std::vector<float> values;

    const float* row(std::int64_t y, std::int64_t z) const {
      return values.data() +
             linearIndex(Index3(0, y, z) - Index3(0, box.first.y, box.first.z), box.count);
    }
  };
  struct Bounds {
    Field low, high;
  };
  // The rows of a plane of voxels, or, with bounds alone, those at a plane of samples.
  struct Plane {
    std::vector<float> low, high;
    std::vector<BinRun> bins;
  };
  class Run;

  // The range of all samples of the chunk.
  ValueRange findSilentRuns();
  // Bit i: that of a row of voxels is one (ErrorTargets::silent_runs).
  RunBits silentRuns(std::int64_t y, std::int64_t z) const {
    const auto blockOf = [&](int axis, std::int64_t at) {
      return std::min((at - voxels_.first[axis]) / kAlignment, block_rows_[axis - 1] - 1);
    };
    return silent_runs_[static_cast<std::size_t>(blockOf(2, z) * block_rows_[0] + blockOf(1, y))];
  }
  void boundOwn(int level);
  void boundHanging(int level);
  // The errors of the leaves of `level` as codes of the cells of `cell_level` that have them.
  void run(int level, Corners corners, int cell_level, ErrorCodes& out);

  const Lattice* lattice_ = nullptr;
  ErrorBins bins_;
  float slack_ = 0;
  IndexBox voxels_;                              // the closed box
  std::uint32_t first_bin_ = 0, bin_count_ = 0;  // that the chunk's samples touch
  std::vector<float> bin_ends_;                  // of these bins
  Field samples_[kMostErrorLevel + 1];
  std::array<std::int64_t, 2> block_rows_{};  // blocks of kAlignment cells along y and z
  std::vector<RunBits> silent_runs_;          // of these rows of blocks
  Bounds own_[kMostErrorLevel + 1], hanging_;
  Plane planes_[2], sample_planes_[2], between_planes_;
  std::vector<float> greatest_;  // errors of two layers of cells, still by voxels along x
  std::vector<RunBits> touched_;
  ErrorCodes hanging_codes_, own_codes_, spread_codes_, touching_[2];
  ErrorCodes found_[kMostErrorLevel - kFirstErrorLevel + 1];
};

}  // namespace isobrick
