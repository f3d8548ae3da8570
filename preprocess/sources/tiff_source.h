// Volumes of TIFF pictures. Private to preprocess/sources/.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// The note on a stack of slices that have no distance.
inline constexpr char kNoSliceDistance[] =
    "image slices have no distance; that of pixels along x was used";

// A file of several pages, of whose images, channels and times the options choose; null if it does
// not begin as a TIFF. Pictures that are packed or in tiles are unpacked as a whole and read in
// order, others box by box. The file may be hostile. Opening reads tags and no pixels, and throws
// Error that names the file and says what is not supported; reading throws Error that names the
// slice, too.
std::unique_ptr<VolumeSource> openTiffFile(const std::string& path, const OpenOptions& options);

// The files of a folder, of which `info` has source and notes: one slice each, or the files of one
// OME-TIFF.
std::unique_ptr<VolumeSource> openTiffStack(VolumeInfo info, const std::vector<std::string>& files,
                                            const OpenOptions& options);

}  // namespace isobrick
