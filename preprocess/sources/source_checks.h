// The checks of every volume source before it promises a VolumeInfo. Private to
// preprocess/sources/.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// `text` of a file or a library in quotes, fit for a line of a message: blanks for control
// characters, and no more than `most_characters` of it.
std::string quotedText(const std::string& text, std::size_t most_characters);
// The first of some names so, for a message: "'a', 'b', ...".
std::string quotedList(const std::vector<std::string>& names);

// The number that a choice of a `kind`, "channel" or "time step", takes out of `count`, the first
// without a choice; `info` says so if there are several. Throws Error if there are fewer.
std::int64_t takeOne(const std::string& path, const std::string& kind,
                     std::optional<std::int64_t> wanted, std::int64_t count, VolumeInfo& info);

// Throws Error unless every axis has 2 .. kMaxVoxelsPerAxis voxels. Afterwards the products of
// `voxels` with a voxel's size fit 64 bits.
void checkVoxelCounts(const std::string& path, const Index3& voxels);

}  // namespace isobrick
