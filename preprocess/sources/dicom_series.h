// DICOM files of a folder as a series. Private to preprocess/sources/.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "isobrick/preprocess/sources/dicom_source.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

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
