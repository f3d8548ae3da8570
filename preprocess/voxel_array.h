// An array in memory as level 0 of a pyramid that has no file.
#pragma once

#include <cstdint>
#include <memory>

#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/pyramid.h"

namespace isobrick {

// Voxels where they lie: those of a row follow each other, rows and slices lie anywhere. Strides
// are in voxels and may be below 0.
struct VoxelArray {
  const void* first = nullptr;    // voxel (0, 0, 0); of the type of VolumeInfo, aligned for it
  std::int64_t row_stride = 0;    // from (x, y, z) to (x, y + 1, z)
  std::int64_t slice_stride = 0;  // from (x, y, z) to (x, y, z + 1)
};

// For queries of level 0, by Extractor: the mesh is that of a pyramid of the same volume. A query
// goes once through the bricks that it needs, and copies those that the surface crosses; of
// float32, this goes once through the array, on the calling TBB arena, for the range of its values.
// The array outlives the result, and does not change meanwhile. Throws Error for NaN and infinite
// voxels.
std::unique_ptr<const Pyramid> pyramidOfArray(const VolumeInfo& info, const VoxelArray& array);

}  // namespace isobrick
