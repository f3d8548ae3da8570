// The slices of a DICOM volume in their order, be they files of a series or frames of a file.
// Private to preprocess/sources/.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <glm/vec3.hpp>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/preprocess/sources/dicom_header.h"
#include "isobrick/preprocess/sources/dicom_values.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// One slice: its place by its header.
struct DicomPlace {
  std::size_t index = 0;               // of the file or the frame
  std::string name;                    // for messages: "'slice7.dcm'", "frame 7"
  std::optional<glm::dvec3> position;  // of its first pixel
  std::int64_t number = 0;             // orders slices without positions
  std::string stack;                   // slices of several stacks are several volumes
  std::vector<std::int64_t> time;      // orders volumes of one stack
  std::vector<std::int64_t> channel;   // further differences of slices: echo, b-value, ...
};

// The error for slices, and its remedy.
struct DicomStackWords {
  std::string path;
  std::string same_position;  // behind "they are at the same position"
  std::string gap;            // behind "they are 2 mm apart and others 1 mm on average"
};

// Leaves the slices of the one volume that options.grid (a stack's name), time and channel (from 0,
// in ascending order) choose, and notes the choice in info.encoding. Throws Error if there are
// several volumes and no choice, or none of that name or number. Different times are different
// volumes if `times_differ` (the header counts volumes), or if slices would be at the same
// position; channels in the latter case alone. `normal`: of the image plane of a slice.
void chooseDicomVolume(const DicomStackWords& words,
                       const std::function<glm::dvec3(const DicomPlace&)>& normal,
                       bool times_differ, const OpenOptions& options,
                       std::vector<DicomPlace>& places, VolumeInfo& info);

// Sorts at least two slices by position along the normal of the image plane, which `geometry` has,
// and gives it the origin and the step from one to the next, in mm. Throws Error if two are at the
// same position, and if the steps differ by more than a tenth. If positions are missing, sorts by
// number, leaves the geometry alone, and returns false.
bool sortDicomSlices(const DicomStackWords& words, std::vector<DicomPlace>& places,
                     GridGeometry& geometry, std::vector<std::string>& notes);

// "1\2\3" as a position.
std::optional<glm::dvec3> dicomPosition(const std::string& text);

struct DicomFrames {
  VolumeInfo info;
  std::vector<std::size_t> frames;  // of each slice, the number of its frame in the file, from 0
  std::vector<DicomValueMap> maps;  // of each slice
  std::size_t frames_in_file = 0;
};

// True if functional groups state the places of frames: other files are read as ITK reads them.
bool hasDicomFrames(const DicomHeader& header);

// Frames sorted by position, with geometry, voxel type, and notes on assumptions. Takes the stack,
// time point, echo, ... that the options choose if there are several, or throws Error. Throws Error
// too if frames differ in a property that a volume has only once, and for colours and frames that
// are no slices.
DicomFrames arrangeDicomFrames(const std::string& path, const DicomHeader& header,
                               const OpenOptions& options);

}  // namespace isobrick
