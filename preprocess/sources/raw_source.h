// Voxels in a file without a header.
#pragma once

#include <memory>
#include <string>

#include "isobrick/preprocess/sources/open_options.h"
#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// Opens a raw file. Throws Error where the file is shorter than offset + voxels, where it is longer
// (wrong dimensions are the usual reason; the message names both sizes), or where an axis has
// fewer than 2 voxels.
std::unique_ptr<VolumeSource> openRawSource(const std::string& path, const RawLayout& layout);

}  // namespace isobrick
