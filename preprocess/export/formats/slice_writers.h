// Stacks of pictures, one a slice. Private to preprocess/export/formats/.
#pragma once

#include <functional>
#include <string>

#include "isobrick/preprocess/export/formats/export_volume.h"

namespace isobrick {

// "folder/slice%04d.exr": whether the name of the file has a place for the number of a slice.
bool isSlicePattern(const std::string& path);

// Throws Error, to be allowed more memory, where not even one slice fits.
void refuseLargeSlices(const VolumeInfo& info, const std::string& path,
                       const ExportOptions& options);
// Calls take(slice, data) for every slice in order.
void forEachSlice(VolumeSource& source, const ExportOptions& options,
                  const std::function<void(std::int64_t slice, const std::byte* data)>& take);

// Calls write(path, slice) for every slice of the finest level, in order, with the file to write
// for it; the folder appears when all are there, and replaces an older one. Holds a slice. Throws
// Error where the pattern has no folder of its own, or no place for a number.
VolumeWriteReport writeSlices(
    VolumeLevels& levels, const std::string& pattern, const ExportOptions& options,
    const std::function<void(const std::string& path, const std::byte* slice)>& write);

// OpenEXR, one channel "Y" of the type that holds all values: half for 8 bits, float for 16 signed
// ones and floats, uint32 for 16 unsigned ones. Type and geometry are attributes (exr_slices.cpp).
VolumeWriteReport writeExrSlices(VolumeLevels& levels, const std::string& path,
                                 const ExportOptions& options);

// TIFF, one file for each slice of a pattern, or one of as many pages (BigTIFF where it may be
// larger than 2 GiB). Pixel spacing is kept as resolution.
VolumeWriteReport writeTiff(VolumeLevels& levels, const std::string& path,
                            const ExportOptions& options);

}  // namespace isobrick
