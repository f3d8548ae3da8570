// The frames of an enhanced DICOM file as the slices of a volume, told by its header alone. Private
// to preprocess/sources/.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "isobrick/preprocess/sources/dicom_header.h"
#include "isobrick/preprocess/sources/dicom_values.h"
#include "isobrick/preprocess/sources/open_options.h"
#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

struct DicomFrames {
  VolumeInfo info;
  std::vector<std::size_t> frames;  // of each slice, the number of its frame in the file, from 0
  std::vector<DicomValueMap> maps;  // of each slice
  std::size_t frames_in_file = 0;
};

// True where functional groups say where frames are: others are read as ITK reads them.
bool hasDicomFrames(const DicomHeader& header);

// Frames sorted by position, with geometry, voxel type, and notes on what was assumed. Several
// stacks, time points, echoes, ...: those of the options, or Error. Throws Error too where frames
// differ in what a volume has only once, and for colours and frames that are no slices.
DicomFrames arrangeDicomFrames(const std::string& path, const DicomHeader& header,
                               const OpenOptions& options);

}  // namespace isobrick
