// Bricks of level 0 that lie in no pyramid: level 0 stays where it is.
#pragma once

#include <cstddef>

#include "isobrick/storage/brick_layout.h"
#include "isobrick/storage/voxel_type.h"

namespace isobrick {

// Gives a Pyramid that has no file its bricks. Voxels are those of the Pyramid's spec. All const
// members are thread-safe, and take bricks that are at hand: which ones are is between who fills
// the supply and who reads the Pyramid.
class BrickSupply {
 public:
  BrickSupply() = default;
  virtual ~BrickSupply() = default;
  BrickSupply(const BrickSupply&) = delete;
  BrickSupply& operator=(const BrickSupply&) = delete;

  // The range of all voxels at the corners of the brick's cells. Goes through them.
  virtual ValueRange range(const Index3& brick) const = 0;
  // Writes the least and the greatest voxel at the corners of each of layout().brickTiles(0,
  // brick), as pairs of voxels, x fastest. Goes through the voxels.
  virtual void copyTileRanges(const Index3& brick, std::byte* out) const = 0;
  // Writes the voxels of layout().brickSampleBox(0, brick), x fastest.
  virtual void copySamples(const Index3& brick, std::byte* out) const = 0;
};

}  // namespace isobrick
