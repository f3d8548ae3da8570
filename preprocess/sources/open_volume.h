// From a path to a volume source, whatever the format.
#pragma once

#include <memory>
#include <string>

#include "isobrick/preprocess/sources/open_options.h"
#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// Opens the volume at `path`: a file of any format that isobrick reads, or a folder with a DICOM
// series or a stack of TIFF slices. VTI and VDB files are known by their ending, others by their
// content; with options.raw the file is read as raw voxels, whatever it is called. Reads headers,
// and no voxels. May be called by several threads at once.
//
// Throws Error for what cannot be opened or read, for formats that this build of isobrick leaves
// out, for pyramids, and (with Remedy::kDescribeRawFile) for files that are known to have no header
// where options.raw is missing; Cancelled.
std::unique_ptr<VolumeSource> openVolume(const std::string& path, const OpenOptions& options = {});

// What openVolume() makes of a source that was opened otherwise, level `level` of a pyramid: with
// the spacing and the origin of the options, where they have them.
std::unique_ptr<VolumeSource> placedAsGiven(std::unique_ptr<VolumeSource> source,
                                            const OpenOptions& options, int level = 0);

// Throws what openVolume() would for a path that is known by its name or its kind not to be usable;
// opens nothing.
void refuseUnusablePath(const std::string& path, const OpenOptions& options = {});

}  // namespace isobrick
