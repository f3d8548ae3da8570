// OpenVDB grids (.vdb). Private to preprocess/export/formats/.
#pragma once

#include <string>

#include "isobrick/preprocess/export/formats/export_volume.h"

namespace isobrick {

// Writes a float grid for each level: voxels that differ from the background are active, the others
// are not stored. A source that came out of a VDB file (VolumeInfo::properties, "vdb.*") gets its
// background, grid class, name and place among the voxels back; of a level set, what lies within
// the narrow band is active.
//
// Each source is read once, in parallel, and its leaves are packed at once: they wait in a
// temporary file beside the output, as long as the grid, until the tree, which comes first in the
// file, is known. So memory holds the nodes of one grid's tree, some 120 bytes for each 8x8x8
// voxels that are not constant, and some 20 MiB a thread; where that is more than
// options.memory_bytes, throws Error with Remedy::kAllowMoreMemory. A source that is read in order
// waits in another such file.
VolumeWriteReport writeVdb(VolumeLevels& levels, const std::string& path,
                           const ExportOptions& options);

}  // namespace isobrick
