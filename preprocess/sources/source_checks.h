// The checks of every volume source before it promises a VolumeInfo. Private to
// preprocess/sources/.
#pragma once

#include <cstddef>
#include <string>

#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// `text` of a file or a library in quotes, fit for a line of a message: blanks for control
// characters, and no more than `most_characters` of it.
std::string quotedText(const std::string& text, std::size_t most_characters);

// Throws Error unless every axis has 2 .. kMaxVoxelsPerAxis voxels. Afterwards the products of
// `voxels` with a voxel's size fit 64 bits.
void checkVoxelCounts(const std::string& path, const Index3& voxels);

// Makes `geometry` fulfil the contract of GridGeometry: positive spacing and an orthonormal
// direction. Negative spacings flip their axis; rounding errors of the file's numbers are
// straightened out (with a note if they are larger than single precision explains). Throws Error
// for spacings that are zero or not finite and for axes that are not at right angles.
void tidyGeometry(const std::string& path, GridGeometry& geometry, std::vector<std::string>& notes);

}  // namespace isobrick
