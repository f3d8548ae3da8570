// From a path to a volume source, whatever the format.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "isobrick/preprocess/sources/open_options.h"
#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// Opens the volume at `path`: a file of any format that isobrick reads, or a folder with a DICOM
// series or a stack of TIFF slices. VTI and VDB files are known by their ending, others by their
// content; with options.raw the file is read as raw voxels, whatever it is called. Reads headers,
// and no voxels. May be called by several threads at once.
//
// Throws Error if the path cannot be opened or read, for formats that this build of isobrick leaves
// out, for pyramids, and (with Remedy::kDescribeRawFile) for files that are known to have no header
// if options.raw is missing; Cancelled.
std::unique_ptr<VolumeSource> openVolume(const std::string& path, const OpenOptions& options = {});

// A format that openVolume() reads, for a list of them.
struct ReadableFormat {
  const char* name;     // "NRRD"
  const char* endings;  // or what else names it; ".mhd .mha"
  bool is_built_in;     // false: this build of isobrick leaves it out
};
// All of them.
std::vector<ReadableFormat> readableFormats();

// Gives a source that was opened otherwise, level `level` of a pyramid, the spacing and the origin
// of the options, if they have them, as openVolume() does.
std::unique_ptr<VolumeSource> placedAsGiven(std::unique_ptr<VolumeSource> source,
                                            const OpenOptions& options, int level = 0);

// Throws the Error of openVolume() if the name or the kind of the path shows that it is not usable;
// opens nothing.
void refuseUnusablePath(const std::string& path, const OpenOptions& options = {});

}  // namespace isobrick
