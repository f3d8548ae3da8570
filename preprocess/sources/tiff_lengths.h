// The distances of a TIFF's pixels and pages. Private to preprocess/sources/.
#pragma once

#include <string>
#include <vector>

#include "isobrick/storage/grid.h"

namespace isobrick {

// What is said of a stack of slices that have no distance.
inline constexpr char kNoSliceDistance[] =
    "image slices have no distance; that of pixels along x was used";

// Spacing and unit by what the first page says: OME-TIFF's PhysicalSizeX to Z, ImageJ's unit and
// spacing, the voxel of a Zeiss LSM, or the resolution in pixels an inch or a centimetre; of a
// resolution without a unit the numbers. Where nothing is said of the distance of slices that of
// pixels along x is taken, and a note says so. Throws Error for a file that is cut short.
void takeTiffLengths(const std::string& path, GridGeometry& geometry,
                     std::vector<std::string>& notes);

}  // namespace isobrick
