// The facts of a volume that has no pyramid: of its headers, and of some of its voxels.
#pragma once

#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/preprocess/volume_source.h"
#include "tools/json_output.h"

namespace isobrick {

// The object that `isobrick info` prints. `source` is read, within some seconds, and is of no use
// afterwards; `options` are those that its pyramid would be built with.
Json factsOfVolume(VolumeSource& source, const BuildOptions& options);

}  // namespace isobrick
