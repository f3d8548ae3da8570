// The value ranges of all bricks, which grow as coarser levels come in.
#pragma once

#include <span>
#include <vector>

#include "isobrick/preprocess/kernels/sample_block.h"
#include "isobrick/storage/voxel_type.h"

namespace isobrick {

// A brick's range is a closure (rule 7): it includes the samples of its own level, of all finer
// ones, and of the coarser ones up to the level at which the brick is a single cell. The first two
// and the nearest coarser levels come with the ranges of its tiles, the others when those levels
// are made. Thread-safe for different bricks of one level.
class BrickClosures {
 public:
  BrickClosures(const BrickLayout& layout);

  // To be called once for every brick of every level, finest level first: `tiles` is the union of
  // the brick's tile ranges, `samples` holds the corners of its cells.
  template <typename T>
  void include(int level, const Index3& brick, const ValueRange& tiles,
               const SampleBlock<T>& samples);

  // In the order of the brick table; final when all bricks were included.
  std::span<const ValueRange> all() const { return ranges_; }
  // Row of a brick in that order.
  std::uint64_t row(int level, const Index3& brick) const {
    return first_row_[static_cast<std::size_t>(level)] +
           static_cast<std::uint64_t>(linearIndex(brick, layout_.bricks(level)));
  }

 private:
  BrickLayout layout_;
  std::vector<std::uint64_t> first_row_;  // per level
  std::vector<ValueRange> ranges_;
};

}  // namespace isobrick
