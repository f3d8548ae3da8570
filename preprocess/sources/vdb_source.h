// OpenVDB grids.
#pragma once

#include <memory>
#include <string>

#include "isobrick/preprocess/sources/open_options.h"
#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// Opens an OpenVDB file (.vdb): the grid named options.grid, or else its first float grid, or its
// first grid of doubles, int32 or int64, which become float32, or of bools or a mask, which become
// 0 and 1; a note names all where there are several. The volume is the box around the active voxels
// and one voxel more on each side, so that surfaces close, or the box that isobrick wrote it from;
// what is not active has the value of the tree there (the background, or the inside of a level
// set). Values are as stored: distances of level sets are negative inside. Class, background and
// first coordinate are properties ("vdb.class", ...).
//
// A grid that fits into options.memory_bytes is held whole, sparse as it is. Of a larger one only
// the nodes and the leaves of some slices are: it is read in order then, once through the file for
// each slab of slices. bufferBytes() says which. Throws Error where there is no such grid, where it
// has no active voxels or a transform that is not linear, and for files that are damaged or cut
// short.
std::unique_ptr<VolumeSource> openVdbSource(const std::string& path,
                                            const OpenOptions& options = {});

}  // namespace isobrick
