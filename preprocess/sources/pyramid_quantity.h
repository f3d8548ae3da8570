// What a pyramid stores beside its samples, as volumes.
#pragma once

#include <cstdint>
#include <memory>

#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/pyramid.h"

namespace isobrick {

enum class PyramidQuantity {
  kLeast,      // of the range of each tile of a level, in the pyramid's voxel type
  kGreatest,   // likewise
  kCurvature,  // of each cell of level 1, in 1/voxel^2 of level 0, float32: a bound of the total
               // curvature (Eq. 2) of every isosurface in it: the greatest of its polynomial's
               // three coefficients; infinite where no bound is known. Of level 0 only
  kError,      // of each cell of level 2 or 3, in the voxels' units, float32: a bound of its error
               // for all isovalues (rule 15)
};

// The quantity for all tiles, nodes or cells that touch the box of samples `box` of `level` in more
// than a side. A voxel is the middle of its tile: spacing is that of the level times the tile's
// cells, and the origin lies half of that inside the first tile. The last tile of an axis may be
// thinner than the grid says. An axis may have a single voxel. Budget, threads and `cancel` as of
// makePyramidSource().
//
// Throws Error where the pyramid has no such level, or was built without the quantity.
std::unique_ptr<VolumeSource> makePyramidQuantity(std::shared_ptr<const Pyramid> pyramid,
                                                  std::uint64_t budget_bytes,
                                                  PyramidQuantity quantity, int level,
                                                  const IndexBox& box,
                                                  const CancelFlag* cancel = nullptr);

}  // namespace isobrick
