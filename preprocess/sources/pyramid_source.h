// One level of a pyramid as a volume.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/pyramid.h"

namespace isobrick {

// The samples of `level`, whole: voxel (i,j,k) is sample (i,j,k) of the level, at the world
// position that docs/FORMAT.md gives it. Spacing is 2^level times the volume's, and the origin is
// the same. Where the last sample of an axis repeats the border voxel, a note says so: it lies
// further in than a regular grid can say. Holds what the pager of `pyramid` holds, `budget_bytes`,
// and nothing more; boxes are read by any number of threads, and one call uses the calling TBB
// arena.
//
// Throws Error where the pyramid has no such level; while it is read, what Pyramid::samples()
// throws, and Cancelled. `cancel`, which may be null, outlives the source.
std::unique_ptr<VolumeSource> makePyramidSource(std::shared_ptr<const Pyramid> pyramid,
                                                std::uint64_t budget_bytes, int level,
                                                const CancelFlag* cancel = nullptr);

}  // namespace isobrick
