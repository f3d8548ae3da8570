// The formats that exportVolume() writes by a library, a function each. Private to
// preprocess/export/formats/.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "isobrick/preprocess/export/formats/export_volume.h"

namespace isobrick {

// If `source` is read in order, reads all of it into a temporary file in `folder`, which takes its
// place, is as long as the volume, and is removed with it. Throws ResumableError if there is no
// room for it, Cancelled, and what the source throws.
void makeReadBoxes(std::unique_ptr<VolumeSource>& source, const std::string& folder,
                   const VolumeWriteOptions& options);

// "folder/slice%04d.exr": whether the name of the file has a place for the number of a slice.
bool isSlicePattern(const std::string& path);

// Throws Error with Remedy::kAllowMoreMemory if not even one slice fits.
void refuseLargeSlices(const VolumeInfo& info, const std::string& path,
                       const ExportOptions& options);
// Calls take(slice, data) for every slice in order.
void forEachSlice(VolumeSource& source, const ExportOptions& options,
                  const std::function<void(std::int64_t slice, const std::byte* data)>& take);

// Calls write(path, slice) for every slice of the finest level, in order, with the file to write
// for it; the folder appears when all are there, and replaces an older one. Holds a slice. Throws
// Error if the pattern has no folder of its own, or no place for a number.
VolumeWriteReport writeSlices(
    VolumeLevels& levels, const std::string& pattern, const ExportOptions& options,
    const std::function<void(const std::string& path, const std::byte* slice)>& write);

// OpenEXR, one channel "Y" of the type that holds all values: half for 8 bits, float for 16 signed
// ones and floats, uint32 for 16 unsigned ones. Type and geometry are attributes (exr_slices.cpp).
VolumeWriteReport writeExrSlices(VolumeLevels& levels, const std::string& path,
                                 const ExportOptions& options);

// TIFF, one file for each slice of a pattern, or one of as many pages (BigTIFF if it may be larger
// than 2 GiB). Pixel spacing is kept as resolution.
VolumeWriteReport writeTiff(VolumeLevels& levels, const std::string& path,
                            const ExportOptions& options);

// Writes "file.h5:/path" (default path: /volume): a dataset of z, y, x in chunks of 64 voxels an
// axis, shuffled and packed with deflate, and its geometry in the attributes "spacing", "origin",
// "direction" (three columns) and "space". A row of chunks is held at a time; a source that is read
// in order waits in a temporary file beside the output.
VolumeWriteReport writeHdf5(VolumeLevels& levels, const std::string& path,
                            const ExportOptions& options);

// Writes a float grid for each level: voxels that differ from the background are active, the others
// are not stored. A source that came out of a VDB file (VolumeInfo::properties, "vdb.*") gets its
// background, grid class, name and place among the voxels back; of a level set, the voxels within
// the narrow band are active.
//
// Each source is read once, in parallel, and its leaves are packed at once: they wait in a
// temporary file beside the output, as long as the grid, until the tree, which comes first in the
// file, is known. So memory holds the nodes of one grid's tree, some 120 bytes for each 8x8x8
// voxels that are not constant, and some 20 MiB a thread; if that is more than
// options.memory_bytes, throws Error with Remedy::kAllowMoreMemory. A source that is read in order
// waits in another such file.
VolumeWriteReport writeVdb(VolumeLevels& levels, const std::string& path,
                           const ExportOptions& options);

// Writes a folder, OME-Zarr 0.5 (Zarr 3) or 0.4 (Zarr 2), as options.zarr_version says: an array
// for each level, of chunks of 64 voxels an axis; chunks of nothing but 0 are left out. Blosc packs
// them: in 0.5 with Zstandard, and many chunks are one file, a shard with an index at its end that
// has a checksum (CRC-32C); in 0.4 with LZ4. Sample i of level l lies at index i * 2^l of level 0,
// so that scale doubles and the translation stays. The direction, for which the format has no
// place, goes into an attribute of isobrick's own. Chunks are packed in parallel; a source that is
// read in order waits in a temporary file beside the output.
VolumeWriteReport writeOmeZarr(VolumeLevels& levels, const std::string& path,
                               const ExportOptions& options);

}  // namespace isobrick
