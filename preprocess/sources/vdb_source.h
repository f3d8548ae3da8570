// OpenVDB grids.
#pragma once

#include <memory>
#include <string>

#include "isobrick/preprocess/sources/open_options.h"
#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// Opens an OpenVDB file (.vdb): its first float grid, or else its first grid of doubles, int32 or
// int64, which become float32; a note names it where there are several. The volume is the box
// around the active voxels and one voxel more on each side, so that surfaces close; what is not
// active has the value of the tree there (the background, or the inside of a level set). Values are
// as stored: distances of level sets are negative inside. The whole grid is held in memory, sparse
// as it is: bufferBytes(). Throws Error where there is no such grid, where it has no active voxels
// or a transform that is not linear, and for files that are damaged or cut short.
std::unique_ptr<VolumeSource> openVdbSource(const std::string& path,
                                            const OpenOptions& options = {});

}  // namespace isobrick
