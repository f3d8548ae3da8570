// Stacks of OpenEXR pictures.
#pragma once

#include <memory>
#include <string>

#include "isobrick/preprocess/sources/open_options.h"
#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// Whether most pictures of the folder are files that end in .exr.
bool hasExrSlices(const std::string& folder);

// Opens a folder of OpenEXR pictures, one a slice, in the order of the numbers in their names: the
// channel named options.grid, or else "Y", or else the first; a note says which of several. Halves
// and floats become float32, uint32 too, with a note; what isobrick wrote gets back the type and
// the geometry that it wrote beside. Scan lines, tiles (of the finest level) and files of several
// parts are read, the first part that has the channel; deep pictures are not. All slices have the
// data window and the channel of the first. Holds one slice. Throws Error that names the file.
std::unique_ptr<VolumeSource> openExrSlices(const std::string& folder,
                                            const OpenOptions& options = {});

}  // namespace isobrick
