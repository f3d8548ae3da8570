// Whether a file that ITK reads as a whole has all of its voxels. Private to preprocess/sources/.
#pragma once

#include <cstdint>
#include <string>

namespace isobrick {

// ITK's readers of MRC, GIPL and VTK legacy files (`format`) do not notice where a file ends before
// its `voxel_bytes`, and return whatever memory held. Throws Error that names the file where it is
// shorter than its header and them; packed and text files, and other formats, are let through.
void checkImageBytes(const std::string& path, const std::string& format, std::uint64_t voxel_bytes);

}  // namespace isobrick
