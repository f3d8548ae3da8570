// Samples of the levels that a build has written, read back.
#pragma once

#include <cstdint>
#include <vector>

#include "isobrick/preprocess/recent_cache.h"
#include "isobrick/storage/brick_layout.h"
#include "isobrick/storage/pyramid_writer.h"

namespace isobrick {

// Keeps the bricks that were asked for last, unpacked. T is the voxel type. All members are
// thread-safe, while nobody writes bricks.
template <typename T>
class WrittenBricks {
 public:
  // `writer` outlives this object. The bricks that are kept take up to `budget_bytes`, or one.
  WrittenBricks(const PyramidSpec& spec, const PyramidWriter& writer, std::uint64_t budget_bytes);

  // Copies the samples in a box of a level, as floats, x fastest. Throws ResumableError where a
  // brick cannot be read.
  void read(int level, const IndexBox& box, float* out);
  // Ranges of the tiles of a brick, x fastest.
  std::vector<ValueRange> tileRanges(int level, const Index3& brick) const;
  // Of a brick in the table.
  std::uint64_t row(int level, const Index3& brick) const;

 private:
  using Samples = typename RecentCache<std::uint64_t, T>::Value;

  Samples samples(int level, const Index3& brick);

  const BrickLayout layout_;
  const PyramidWriter& writer_;
  std::vector<std::uint64_t> first_rows_;  // of the levels
  RecentCache<std::uint64_t, T> kept_;     // by row
};

}  // namespace isobrick
