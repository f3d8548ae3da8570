// Where level 1 is near enough to level 0, for all threads of a query.
#pragma once

#include <tbb/concurrent_unordered_map.h>

#include <cstdint>
#include <vector>

#include "isobrick/storage/brick_layout.h"

namespace isobrick {

struct MeshContext;

// The blocks of a brick of level 0 (BrickLayout::brickCurvatureBlocks) as rows of bits along x.
struct FlatRows {
  Index3 count{0};                  // of blocks
  std::vector<std::uint32_t> bits;  // row y + count.y * z: bit x is 1 if the block is flat
};

// Reads the bounds of a brick when it is first asked for. Thread-safe.
class FlatBlocks {
 public:
  // Flat is what deviates by at most so many voxels.
  explicit FlatBlocks(double most_deviation) : most_deviation_(most_deviation) {}

  // Stays where it is.
  const FlatRows& of(const MeshContext& context, const Index3& brick);

 private:
  double most_deviation_;
  tbb::concurrent_unordered_map<std::size_t, FlatRows> bricks_;  // by row of the brick table
};

}  // namespace isobrick
