// What the headers of VTK ImageData files say, of XML (.vti, .pvti) and of legacy ones (.vtk), and
// the voxels of an array (vti_voxels.cpp). Private to preprocess/sources/.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/stored_voxels.h"

namespace isobrick {

// One DataArray of the point or cell data.
struct VtiArray {
  std::string name;
  std::string type;    // "UInt8", ...
  std::string format;  // "appended", "binary" or "ascii"
  std::uint64_t components = 1;
  std::uint64_t offset = 0;   // appended: bytes or characters behind the '_'
  std::uint64_t text_at = 0;  // otherwise: the byte of the file behind the tag
};

struct VtiPiece {
  std::string extent;
  std::string source;  // the file that it is, in a .pvti
  // The arrays, and the name that the file has for the one to take.
  struct Data {
    std::string scalars;
    std::vector<VtiArray> arrays;
  };
  Data points, cells;
};

// The statements of a file, as they stand: nothing but its syntax was checked, and a missing one is
// empty.
struct VtiHeader {
  std::string file_type, byte_order, header_type, compressor;  // of VTKFile
  std::string whole_extent, origin, spacing, direction;        // of ImageData
  std::vector<VtiPiece> pieces;
  std::string appended_encoding;  // "raw" or "base64"; empty if nothing is appended
  std::uint64_t appended_at = 0;  // the byte of the file behind the '_'
};

// Text of a file, fit for a line of a message.
std::string inQuotes(const std::string& text);
// "cannot use 'PATH': REASON; ...", with a remedy.
template <typename... Parts>
Error cannotUseVti(const std::string& path, const Parts&... reason) {
  return unusable(path, reason..., "; save it again with ParaView, or convert it to .nrrd or .mhd");
}

// Reads the tags of the file, with Expat, up to its appended data or its end; text between tags is
// passed over. Throws Error, naming the byte, for anything but well-formed XML of the kind that VTK
// writes: elements, attributes, comments and processing instructions.
VtiHeader readVtiHeader(const InputFile& file);

// As of a VTI file with the same arrays of points and cells, in one piece; their format is "ascii",
// or "bare" for bytes in order of the network from VtiArray::text_at on. Bytes between headers are
// passed over. Throws Error, naming the byte, for anything but STRUCTURED_POINTS.
VtiHeader readVtkLegacyHeader(const InputFile& file);

// Whether blocks packed by the compressor of that name can be read, or it is "".
bool knowsVtiCompressor(const std::string& compressor);

// `info` is that of the source; its voxels are all that the array has, numbers of `stored`.
// `cancel`, which may be null, outlives the source. Throws Error if the array has another number of
// bytes.
std::unique_ptr<VolumeSource> openVtiVoxels(std::shared_ptr<const InputFile> file,
                                            const VtiHeader& header, const VtiArray& array,
                                            const StoredVoxels& stored, VolumeInfo info,
                                            const CancelFlag* cancel);

}  // namespace isobrick
