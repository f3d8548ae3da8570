// The formats that openVolume() reads, a function each. Private to preprocess/sources/.
#pragma once

#include <memory>
#include <string>
#include <utility>

#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// Opens a raw file. Throws Error if the file is shorter than offset + voxels, if it is longer
// (wrong dimensions are the usual reason; the message names both sizes), or if an axis has fewer
// than 2 voxels.
std::unique_ptr<VolumeSource> openRawSource(const std::string& path, const RawLayout& layout);

// Opens VTK XML ImageData (.vti): the array of its points, or else of its cells, that is named
// options.grid, or marked as scalars, or the first with one value per voxel; of one piece or
// several; appended (raw or base64), inline binary or text; plain or compressed by zlib, LZ4 or
// LZMA. Direction, and extents that do not begin at 0, are applied; a cell's voxel is its centre.
// 32- and 64-bit integers and doubles become float32 with a note. Throws Error for everything else,
// and if the sizes in the file contradict each other.
std::unique_ptr<VolumeSource> openVtiSource(const std::string& path,
                                            const OpenOptions& options = {});

// NRRD, MetaImage, NIfTI-1 and -2, Analyze 7.5 and MRC: whether a file is one, by its first bytes
// or its name, and its volume. Numbers of all types are read, packed with gzip or not, in one file
// or several, and as text where the format has it, a few rows at a time. Of several values a voxel,
// time steps and images the options choose one. The places of voxels follow the rules of the
// format, whatever a library makes of them; NIfTI's world is turned to that of DICOM. Throw Error
// that names the file.
bool isNrrdFile(const std::string& path);
std::unique_ptr<VolumeSource> openNrrdSource(const std::string& path,
                                             const OpenOptions& options = {});
bool isMetaImageFile(const std::string& path);
std::unique_ptr<VolumeSource> openMetaImageSource(const std::string& path,
                                                  const OpenOptions& options = {});
bool isNiftiFile(const std::string& path);
std::unique_ptr<VolumeSource> openNiftiSource(const std::string& path,
                                              const OpenOptions& options = {});
bool isMrcFile(const std::string& path);
std::unique_ptr<VolumeSource> openMrcSource(const std::string& path,
                                            const OpenOptions& options = {});

// Whether it is a Zarr store, a folder or a zip file or a path through one, by the names of the
// files in it.
bool isZarrFolder(const std::string& path);

// Opens a Zarr store: an OME-Zarr image of version 0.4 or before (Zarr 2) or 0.5 (Zarr
// 3, sharded or not), of which the finest level is taken; or an array, such as one of its levels
// ("scan.ome.zarr/1"). Read are all integers and floats of both byte orders, C and F order, both
// separators, chunks that are missing, packed with Blosc (LZ4, zlib, Zstandard), zlib, gzip or
// Zstandard. Scale and translation of OME are spacing and origin: a voxel is its centre. For
// several time steps or channels the first is taken, with a note, or the ones in options.time and
// options.channel. Boxes are read; unpacked chunks are kept up to options.memory_bytes.
//
// Everything in a store may be hostile: names of levels do not lead out of it, sizes are checked
// before anything is allocated. Throws Error that names the file.
std::unique_ptr<VolumeSource> openZarrSource(const std::string& path,
                                             const OpenOptions& options = {});

// Opens anything that ITK reads: DICOM, TIFF, PNG; a folder is a DICOM series (it
// must hold exactly one) or a stack of TIFF slices. Slope and intercept, spacing, origin and
// direction are applied. No pixels are decoded: the voxel type of a series follows from its headers
// (dicom_values.h), each of which is read once.
std::unique_ptr<VolumeSource> openItkSource(const std::string& path,
                                            const OpenOptions& options = {});

// The note on a stack of slices that have no distance.
inline constexpr char kNoSliceDistance[] =
    "image slices have no distance; that of pixels along x was used";

// A file of several pages, of whose images, channels and times the options choose; null if it does
// not begin as a TIFF. Pictures that are packed or in tiles are unpacked as a whole and read in
// order, others box by box. The file may be hostile. Opening reads tags and no pixels, and throws
// Error that names the file and says what is not supported; reading throws Error that names the
// slice, too.
std::unique_ptr<VolumeSource> openTiffFile(const std::string& path, const OpenOptions& options);

// The files of a folder, of which `info` has source and notes: one slice each, or the files of one
// OME-TIFF.
std::unique_ptr<VolumeSource> openTiffStack(VolumeInfo info, const std::vector<std::string>& files,
                                            const OpenOptions& options);

// Whether most pictures of the folder are files that end in .exr.
bool hasExrSlices(const std::string& folder);

// Opens a folder of OpenEXR pictures, one a slice, in the order of the numbers in their names: the
// channel named options.grid, or else "Y", or else the first; a note says which of several. Halves
// and floats become float32, uint32 too, with a note; pictures that isobrick wrote get back the
// type and the geometry that it wrote beside. Scan lines, tiles (of the finest level) and files of
// several parts are read, the first part that has the channel; deep pictures are not. All slices
// have the data window and the channel of the first. Holds one slice. Throws Error that names the
// file.
std::unique_ptr<VolumeSource> openExrSlices(const std::string& folder,
                                            const OpenOptions& options = {});

// Opens an OpenVDB file (.vdb): the grid named options.grid, or the one of that number, from 0, if
// none has that name; without it its first float grid, or its
// first grid of doubles, int32 or int64, which become float32, or of bools or a mask, which become
// 0 and 1; a note names all if there are several. The volume is the box around the active voxels
// and one voxel more on each side, so that surfaces close, or the box that isobrick wrote it from;
// inactive voxels have the value of the tree there (the background, or the inside of a level set).
// Values are as stored: distances of level sets are negative inside. Class, background and first
// coordinate are properties ("vdb.class", ...).
//
// A grid that fits into options.memory_bytes is held whole, sparse as it is. For a larger one only
// the nodes and the leaves of some slices are: it is read in order then, once through the file for
// each slab of slices. bufferBytes() says which. Throws Error if there is no such grid, if it has
// no active voxels or a transform that is not linear, and for files that are damaged or cut short.
std::unique_ptr<VolumeSource> openVdbSource(const std::string& path,
                                            const OpenOptions& options = {});

// Those of numbers, in the order of the file. Reads what stands in front of each.
std::vector<std::string> vdbGridNames(const std::string& path, const OpenOptions& options);

// Opens a dataset of an HDF5 file, "file.h5:/path" (../hdf5_name.h); without a path, the only one
// of three axes or more, or the finest level of a file of Imaris or BigDataViewer, whose .xml may
// be named, too (hdf5_dataset.h). Axes are x, y and z by the names that the file has for them, or
// else the last three, slowest first; one or two others take an index of options.time and
// options.channel (hdf5_dataset.h). Integers and floats of either byte order, in one piece or in
// chunks packed with filters that the library, its plugins or isobrick have; the others are named
// (hdf5_needs.cpp). hdf5_dataset.h has what counts as their place; otherwise the spacing is 1.
//
// Boxes are read, by one thread at a time: the library is not made for more. It keeps chunks of up
// to options.memory_bytes. The file may be hostile: the library's results are checked before
// anything is allocated. Throws Error that names the file.
std::unique_ptr<VolumeSource> openHdf5Source(const std::string& name,
                                             const OpenOptions& options = {});

}  // namespace isobrick
