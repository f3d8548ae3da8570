// DICOM files of a folder as a series, and the pixels of their slices as a volume. Private to
// preprocess/sources/.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/preprocess/sources/dicom_header.h"
#include "isobrick/preprocess/sources/dicom_values.h"
#include "isobrick/preprocess/sources/open_volume.h"
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

// The header of a DICOM image; nothing of files that are no DICOM. Throws Error for DICOM files
// that are damaged or hold no image.
std::optional<DicomHeader> dicomImageHeader(const std::string& path);

// A DICOM file with all slices (frames).
std::unique_ptr<VolumeSource> openDicomFile(const std::string& path, const DicomHeader& header,
                                            const OpenOptions& options);

// What is kept of the header of a file.
struct SeriesFile {
  DicomFile file;
  std::string fault;  // of its pixels
  std::string series_uid, series_number, description;
  std::string position, orientation, instance, time;
  std::string photometric;
  std::vector<double> pixel_spacing;
  double slice_distance = 0;  // of slices without positions, or their thickness; 0: unknown
  bool has_idle_rescale = false;
};

struct DicomScan {
  std::vector<SeriesFile> images;
  std::vector<std::string> damaged;  // files that begin as DICOM and are not whole

  // So that it can be compared with pictures: a file of many frames is many slices.
  std::int64_t pictures() const;
};

// Whether the file has the name of the list that a medium has of its series.
bool isDicomDirectory(const std::string& path);

// The DICOM images among `files`. Only headers are read.
DicomScan scanDicom(const std::vector<std::string>& files, const OpenOptions& options);

// The only series of a scan, or the one that the options choose.
std::unique_ptr<VolumeSource> openDicomSeries(const std::string& folder, DicomScan scan,
                                              const OpenOptions& options,
                                              std::vector<std::string> notes);

}  // namespace isobrick
