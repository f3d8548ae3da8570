// What `isobrick convert` may write over.
#pragma once

#include <string>
#include <vector>

namespace isobrick {

// The rule of tools/output_check.h for all that convert writes: files, and folders of slices or of
// OME-Zarr, which are replaced with `force` where nothing else is in them. A file of HDF5 may be
// there, and its writer looks for the dataset. `inputs`: what the user named, and all files of it.
void refuseConvertOutput(const std::string& output, const std::vector<std::string>& inputs,
                         bool force);

}  // namespace isobrick
