// OME-Zarr images. Private to preprocess/export/formats/.
#pragma once

#include <string>

#include "isobrick/preprocess/export/formats/export_volume.h"

namespace isobrick {

// Writes a folder, OME-Zarr 0.4 (Zarr version 2): an array for each level, of chunks of 64 voxels
// an axis, packed by Blosc with LZ4; chunks of nothing but 0 are left out. Sample i of level l lies
// at index i * 2^l of level 0, so that scale doubles and the translation stays. The direction,
// which the format does not know, goes into an attribute of isobrick's own. Chunks are packed and
// written in parallel; a source that is read in order waits in a temporary file beside the output.
VolumeWriteReport writeOmeZarr(VolumeLevels& levels, const std::string& path,
                               const ExportOptions& options);

}  // namespace isobrick
