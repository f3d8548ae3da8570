// Whether a TIFF file has all of its pages, and the lengths that the first one states. Private to
// preprocess/sources/.
#pragma once

#include <string>
#include <vector>

#include "isobrick/preprocess/sources/stored_voxels.h"
#include "isobrick/storage/grid.h"

namespace isobrick {

// libtiff takes a file that ends within its list of pages as one of fewer pages, and ITK assumes
// that all pages are as large as the first and reads beyond smaller ones. Throws Error that names
// the file if the list leads out of it or in a circle, or if pages differ; smaller pictures beside
// the pages may differ. libtiff finds other faults of a page.
void checkTiffPages(const std::string& path);

// ITK leaves 32-bit integers at zero, and takes halves and some planes for other numbers. Throws
// Error that names the file unless `type`, which ITK finds, is that of the first page's numbers and
// one that it reads.
void refuseMisreadTiff(const std::string& path, StoredType type);

// The note on a stack of slices that have no distance.
inline constexpr char kNoSliceDistance[] =
    "image slices have no distance; that of pixels along x was used";

// Spacing and unit by the first page: OME-TIFF's PhysicalSizeX to Z, ImageJ's unit and spacing, the
// voxel of a Zeiss LSM, or the resolution in pixels an inch or a centimetre; the numbers of a
// resolution without a unit. If the distance of slices is not stated, that of pixels along x is
// taken, and a note says so. Throws Error for a file that is cut short.
void takeTiffLengths(const std::string& path, GridGeometry& geometry,
                     std::vector<std::string>& notes);

}  // namespace isobrick
