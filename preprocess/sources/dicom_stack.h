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
#include "isobrick/preprocess/sources/dicom_source.h"
#include "isobrick/preprocess/sources/dicom_values.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// One slice: its place by its header.
struct DicomPlace {
  std::size_t index = 0;               // of the file or the frame
  std::string name;                    // for messages: "'slice7.dcm'", "frame 7"
  std::optional<glm::dvec3> position;  // of its first pixel
  double rounding = 0;                 // of its numbers: a unit of the last decimal
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

// Sorts at least two slices by position along the normal of the image plane, which `geometry` has
// with its spacing, and gives it the origin and the step from one to the next, in mm. Throws Error
// if two are at the same position, and if one is further than a hundredth of a voxel, or than the
// rounding of the positions explains, from where an even grid of right angles has it. If positions
// are missing, sorts by number, leaves the geometry alone, and returns false.
bool sortDicomSlices(const DicomStackWords& words, std::vector<DicomPlace>& places,
                     GridGeometry& geometry, std::vector<std::string>& notes);

// "1\2\3" as the position of a slice; none if it is something else.
void takeDicomPosition(const std::string& text, DicomPlace& place);

// The distances of pixels along x and y, in mm, of a frame; empty if the header has none.
std::vector<double> dicomPixelSpacing(const DicomHeader& header, std::size_t frame);

// The distance of slices, or else their thickness, in mm, that a frame states; 0: none.
double dicomSliceDistance(const DicomHeader& header, std::size_t frame);

// Whether spacings (with the unit 0), or orientations (1), are the same for a picture of so many
// pixels along its longer side: to a hundredth of a pixel at its end.
bool areSameForPixels(const std::vector<double>& a, const std::vector<double>& b,
                      std::int64_t pixels, double unit);

struct DicomFrames {
  VolumeInfo info;
  std::vector<DicomSlice> slices;
};

// Frames of a file sorted by position, with geometry, voxel type, and notes on assumptions. Takes
// the stack, time point, echo, ... that the options choose if there are several, or throws Error.
// Throws Error too if frames differ in a property that a volume has only once, and for colours and
// frames that are no slices. Frames of a file that does not state the place of each are stacked as
// they come.
DicomFrames arrangeDicomFrames(const std::string& path, const DicomHeader& header,
                               const OpenOptions& options);

}  // namespace isobrick
