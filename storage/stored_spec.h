// The facts of a pyramid as the header of its file has them.
#pragma once

#include <cstdint>
#include <optional>

#include "isobrick/storage/format.h"
#include "isobrick/storage/pyramid_info.h"

namespace isobrick {

bool isPowerOfTwoWithin(std::uint32_t value, std::uint32_t least, std::uint32_t greatest);

// Nothing if a number of the header is impossible; its version is one that is read, and its voxels
// are no labels. The geometry may be unusable (isUsableGeometry()), and levels, tables and the
// division are not looked at.
std::optional<PyramidSpec> storedSpec(const format::Header& header);

}  // namespace isobrick
