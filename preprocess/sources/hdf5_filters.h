// Filters of HDF5 that pack chunks. Private to the files that read HDF5; a caller holds an
// Hdf5Call.
#pragma once

#include <string>

#include "isobrick/preprocess/hdf5_handle.h"

namespace isobrick {

// Throws Error that says which filter is missing here, and how to get it, unless all chunks of a
// dataset with these properties can be unpacked: by the library, by its plugins, or by isobrick's
// own filters for LZF, Zstandard and Bitshuffle, for which Debian has no plugin, or none that loads
// without MPI. `name` is the dataset's for the message.
void requireFilters(hid_t creation, const std::string& name);

}  // namespace isobrick
