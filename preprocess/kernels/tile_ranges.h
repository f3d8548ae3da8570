// Value ranges of the tiles of a brick as closures over all levels that meshing may read (rule 7).
#pragma once

#include <vector>

#include "isobrick/preprocess/kernels/sample_block.h"
#include "isobrick/storage/voxel_type.h"

namespace isobrick {

// Least and greatest value of each cube of a dense block of cubes, x fastest.
template <typename T>
struct CubeRanges {
  Index3 dims{0};
  std::vector<T> min, max;

  // Empty ranges, to be widened.
  void reset(const Index3& new_dims);
  std::size_t size() const { return min.size(); }
  // Zeros are positive: which of two zeros is the lesser depends on the machine.
  ValueRange range(std::size_t cube) const {
    return {static_cast<float>(min[cube]) + 0.0f, static_cast<float>(max[cube]) + 0.0f};
  }
};

// The least and the greatest sample of the block, none NaN. T: a voxel type. Zeros are positive.
template <typename T>
ValueRange rangeOfBlock(const SampleBlock<T>& samples);

// Widens each range by the samples in its closed cube. The cubes are the blocks of `edge`^3 cells
// that cut up the box `cells` of the block's level, fewer at its far sides: ranges.dims is
// ceil(cells.count / edge). `samples` holds all corners of `cells`. T: a voxel type. Thread-safe
// for different `ranges`. `has_missing`: samples may be NaN, and no range takes those in.
template <typename T>
void includeClosedCubes(const SampleBlock<T>& samples, const IndexBox& cells, std::int64_t edge,
                        CubeRanges<T>& ranges, bool has_missing = false);

}  // namespace isobrick
