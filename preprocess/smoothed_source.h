// A volume that is smoothed as it is read (kernels/smoothing.h).
#pragma once

#include <memory>
#include <vector>

#include "isobrick/preprocess/derived_volume.h"
#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// As Derivation::denoise says. Each voxel is computed from its neighbours in a fixed order, so it
// is the same for any rows that are asked for at a time, and any number of threads. Works on the
// calling TBB arena. `shifts` may be null; its isovalues say which surfaces are watched.
std::unique_ptr<VolumeSource> makeSmoothedSource(std::unique_ptr<VolumeSource> source, double sigma,
                                                 std::shared_ptr<std::vector<SurfaceShift>> shifts);

}  // namespace isobrick
