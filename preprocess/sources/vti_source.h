// VTK XML ImageData.
#pragma once

#include <memory>
#include <string>

#include "isobrick/preprocess/sources/open_options.h"
#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// Opens VTK XML ImageData (.vti): one piece; of its point data the array that is marked as scalars,
// or the first with one value per voxel; appended (raw or base64) or inline binary, plain or
// compressed by zlib. Direction, and extents that do not begin at 0, are applied. 32- and 64-bit
// integers and doubles become float32 with a note. Throws Error for everything else, and where the
// sizes in the file contradict each other.
std::unique_ptr<VolumeSource> openVtiSource(const std::string& path,
                                            const OpenOptions& options = {});

}  // namespace isobrick
