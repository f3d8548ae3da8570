// HDF5 datasets.
#pragma once

#include <memory>
#include <string>
#include <utility>

#include "isobrick/preprocess/sources/open_options.h"
#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// "scan.h5:/entry/data" as its file and its dataset, which is empty where none is named; nothing
// but the whole word as a file where it has no such form (.h5, .hdf5, .hdf, .he5, .nxs).
std::pair<std::string, std::string> splitHdf5Name(const std::string& name);
bool isHdf5Name(const std::string& name);

// Opens a dataset of three axes, slowest first, "file.h5:/path"; without a path, the only one that
// the file has. More axes are taken where all others have one element, or with options.channel for
// a single further one. Integers and floats of either byte order, in one piece or in chunks packed
// with filters that the library has; the others are named. Attributes "spacing", "origin" and
// "direction" (of the axes x, y, z, the last as three columns) are the geometry, or
// "element_size_um" (z, y, x) the spacing; otherwise the spacing is 1.
//
// Boxes are read, by one thread at a time: the library is not made for more. It keeps chunks of up
// to options.memory_bytes. The file may be hostile: what the library makes of it is checked before
// anything is allocated. Throws Error that names the file.
std::unique_ptr<VolumeSource> openHdf5Source(const std::string& name,
                                             const OpenOptions& options = {});

}  // namespace isobrick
