// The outputs that `isobrick convert` may write over.
#pragma once

#include <string>
#include <vector>

namespace isobrick {

// The rule of tools/output_check.h for all that convert writes: files, and folders of slices or of
// OME-Zarr, which are replaced with `force` if nothing else is in them. `inputs`: the names that
// the user gave, and all their files.
void refuseConvertOutput(const std::string& output, const std::vector<std::string>& inputs,
                         bool force);

}  // namespace isobrick
