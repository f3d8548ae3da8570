// The value ranges of all bricks, which grow as coarser levels come in.
#pragma once

#include <span>
#include <utility>
#include <vector>

#include "isobrick/preprocess/kernels/sample_block.h"
#include "isobrick/storage/brick_table.h"
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

}  // namespace isobrick
