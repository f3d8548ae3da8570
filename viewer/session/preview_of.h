// What a pyramid that is shown while another one is built is a preview of.
#pragma once

#include "isobrick/storage/grid.h"

namespace isobrick {

// The preview has every `step`-th voxel along each axis, from the first one on, and perhaps not all
// slices of them, in the place of the world where the volume is.
struct PreviewOf {
  std::int64_t step = 2;  // a power of two
  Index3 voxels{2};       // of the volume
};

}  // namespace isobrick
