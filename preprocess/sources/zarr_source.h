// OME-Zarr images, and plain Zarr arrays.
#pragma once

#include <memory>
#include <string>

#include "isobrick/preprocess/sources/open_options.h"
#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// Whether the folder is a Zarr store, by the names of the files in it.
bool isZarrFolder(const std::string& path);

// Opens a Zarr store in a folder: an OME-Zarr image of version 0.4 or before (Zarr 2) or 0.5 (Zarr
// 3, sharded or not), of which the finest level is taken; or an array, such as one of its levels
// ("scan.ome.zarr/1"). Read are all integers and floats of both byte orders, C and F order, both
// separators, chunks that are missing, packed with Blosc (LZ4, zlib, Zstandard), zlib, gzip or
// Zstandard. Scale and translation of OME are spacing and origin: a voxel is its centre. Of several
// time steps or channels the first is taken, with a note, or what options.time and options.channel
// say. Boxes are read; unpacked chunks are kept up to options.memory_bytes.
//
// Everything in a store may be hostile: names of levels do not lead out of it, sizes are checked
// before anything is allocated. Throws Error that names the file.
std::unique_ptr<VolumeSource> openZarrSource(const std::string& path,
                                             const OpenOptions& options = {});

}  // namespace isobrick
