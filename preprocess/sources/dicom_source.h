// The pixels of DICOM slices as a volume. Private to preprocess/sources/.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "isobrick/preprocess/sources/dicom_header.h"
#include "isobrick/preprocess/sources/dicom_values.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/error.h"

namespace isobrick {

// A file with one or more pictures of one size, as far as it is kept: thousands of headers would be
// too much.
struct DicomFile {
  std::string path;
  FileStamp stamp;
  std::string syntax;
  std::uint64_t pixels_at = 0, packed_bytes = 0;  // 0 bytes: they lie as they are
  std::int64_t columns = 0, rows = 0, frames = 1;
  DicomValueMap values;  // of the first frame
};

// Why these pixels are not read, and what to do; "" for grey values of 8, 16 or 32 bits.
std::string faultOfPixels(const DicomHeader& header);

// Of pixels without a fault.
DicomFile dicomFile(const std::string& path, const DicomHeader& header);

struct DicomSlice {
  std::size_t file = 0, frame = 0;  // from 0
  DicomValueMap values;
};

// Slice k of the volume that `info` describes is slices[k]. Pixels that lie in a file as they are
// are read in place; a packed file is unpacked when one of its slices is read, and held until one
// of another file is. Every value is compared with the voxel type: nothing is cut off. Files must
// be those that were walked.
std::unique_ptr<VolumeSource> makeDicomSource(VolumeInfo info, std::vector<DicomFile> files,
                                              std::vector<DicomSlice> slices,
                                              const CancelFlag* cancel);

}  // namespace isobrick
