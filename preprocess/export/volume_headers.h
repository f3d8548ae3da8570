// The headers of volume files that are a header and a run of voxels. Private to preprocess/export/.
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

std::string nrrdHeader(const VolumeInfo& info);
// `data_name`: the file with the voxels, or "LOCAL" if they follow.
std::string metaImageHeader(const VolumeInfo& info, const std::string& data_name);
// All of a .vti up to the first voxel; kVtiEnd follows the last.
std::string vtiHeader(const VolumeInfo& info);
inline constexpr char kVtiEnd[] = "\n  </AppendedData>\n</VTKFile>\n";

// The header of a NIfTI-1 file (.nii) with the four bytes that say that no extension follows; the
// voxels come next. Adds a line to `lost` if single precision changes the geometry. Throws Error
// for more than 32767 voxels along an axis.
inline constexpr std::size_t kNiftiBytes = 352;
std::array<std::byte, kNiftiBytes> niftiHeader(const VolumeInfo& info, const std::string& path,
                                               std::vector<std::string>& lost);

}  // namespace isobrick
