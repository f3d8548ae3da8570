// HDF5 datasets. Private to preprocess/export/formats/.
#pragma once

#include <string>

#include "isobrick/preprocess/export/formats/export_volume.h"

namespace isobrick {

// Writes "file.h5:/path" (default path: /volume): a dataset of z, y, x in chunks of 64 voxels an
// axis, shuffled and packed with deflate, and its geometry in the attributes "spacing", "origin",
// "direction" (three columns) and "space". Of a file that is there already, all else stays as it
// is: a copy with the new dataset takes its place (hdf5_original.h). A row of chunks is held at a
// time; a source that is read in order waits in a temporary file beside the output.
VolumeWriteReport writeHdf5(VolumeLevels& levels, const std::string& path,
                            const ExportOptions& options);

}  // namespace isobrick
