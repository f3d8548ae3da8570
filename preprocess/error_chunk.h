// The stored error bounds (rule 15) of a cube of voxels.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

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

  // All codes 0.
  void reset(const IndexBox& box, std::uint32_t first, std::uint32_t count);
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
  static constexpr std::int64_t kVoxels = 64;  // cells of level 0 per axis
  // Voxels around them that their errors depend on.
  static constexpr std::int64_t kMargin = std::int64_t{1} << kMostErrorLevel;

  // Chunks per axis.
  static Index3 chunks(const Lattice& lattice) {
    return BrickLayout::ceilDivide(lattice.cells(0), kVoxels);
  }
  // Cells of `level` that are a chunk's own.
  static IndexBox cells(const Lattice& lattice, int level, const Index3& chunk);
  // Samples of `level` that find() reads.
  static IndexBox samples(const Lattice& lattice, int level, const Index3& chunk);

  // Copies samples(lattice, level, chunk) of a chunk, x fastest.
  using Read = std::function<void(int level, const IndexBox& box, float* out)>;

  // `values`: of all voxels.
  void find(const Lattice& lattice, const ErrorBins& bins, const ValueRange& values,
            const Index3& chunk, const Read& read);

  // Of the chunk's cells of a level from kFirstErrorLevel to bins.last_level, and maybe some
  // around: for each bin a bound of the error for all its isovalues.
  const ErrorCodes& codes(int level) const { return found_[level - kFirstErrorLevel]; }

 private:
  enum class Corners { kOwn, kHanging };

  // Samples of a level, or one of their bounds, in `box`.
  struct Field {
    IndexBox box;
    std::vector<float> values;

    float at(const Index3& sample) const {
      return values[static_cast<std::size_t>(linearIndex(sample - box.first, box.count))];
    }
  };
  struct Bounds {
    Field low, high;
  };
  // The rows of a plane of voxels.
  struct Plane {
    std::vector<float> low, high;
  };
  class Run;

  // The voxels of a chunk and of a margin around it, both ends of its cells included.
  static IndexBox voxelsAround(const Lattice& lattice, const Index3& chunk, std::int64_t margin);
  IndexBox voxelBox(std::int64_t margin) const { return voxelsAround(*lattice_, chunk_, margin); }
  void boundOwn(int level);
  void boundHanging(int level);
  // The errors of the leaves of `level` in the voxels of the chunk and `margin` around it, as codes
  // of the cells of `cell_level`.
  void run(int level, Corners corners, int cell_level, std::int64_t margin, ErrorCodes& out);

  const Lattice* lattice_ = nullptr;
  ErrorBins bins_;
  float slack_ = 0;
  Index3 chunk_{0};
  std::uint32_t first_bin_ = 0, bin_count_ = 0;  // that the chunk's samples touch
  std::vector<float> least_, most_;              // isovalues of these bins, with some room
  float first_isovalue_ = 0, room_ = 0;
  Field samples_[kMostErrorLevel + 1];
  Bounds own_[kMostErrorLevel + 1], hanging_;
  Plane planes_[2];
  std::vector<float> lattice_row_;  // a row of bounds at samples of the level
  std::vector<float> greatest_;     // errors of a layer of cells, still by voxels along x
  std::vector<std::uint8_t> is_touched_;
  ErrorCodes fine_[2], hanging_codes_, touching_[2];
  ErrorCodes found_[kMostErrorLevel - kFirstErrorLevel + 1];
};

}  // namespace isobrick
