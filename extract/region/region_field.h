// A query's region, as the workers of the query ask for it.
#pragma once

#include <vector>

#include "isobrick/extract/region/mask_voxels.h"
#include "isobrick/extract/region/region_walls.h"
#include "isobrick/extract/surface_region.h"
#include "isobrick/storage/pyramid.h"

namespace isobrick {

// Shared by all threads, each of which has readers of its own. The region outlives it.
class RegionField {
 public:
  // Throws Error for a region that makes no sense for the volume: a number that is not finite, a
  // normal or a radius of 0, a mask of another world.
  RegionField(const SurfaceRegion& region, const Pyramid& volume);

  const SurfaceRegion& region() const { return region_; }
  const std::vector<RegionWall>& walls() const { return walls_; }
  std::vector<MaskReader> readers(const CancelFlag* cancel) const;

  // Of the closed box of these voxels. kCut is a safe answer.
  BoxSide sideOf(const Index3& lower, const Index3& upper) const;
  // True if the voxel is inside. `readers`: those of this thread.
  bool has(const Index3& voxel, std::vector<MaskReader>& readers) const;

 private:
  const SurfaceRegion& region_;
  const std::vector<RegionWall> walls_;
  std::vector<MaskVoxels> masks_;
};

// Whether all masks have the voxel.
inline bool haveAll(std::vector<MaskReader>& readers, const Index3& voxel) {
  for (MaskReader& reader : readers)
    if (!reader.has(voxel)) return false;
  return true;
}

}  // namespace isobrick
