// DICOM files of a folder as a series, and the pixels of their slices as a volume. Private to
// preprocess/sources/.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <glm/vec3.hpp>
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

// ---- slices in their order, be they files of a series or frames of a file: dicom_stack.cpp

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

// The grid of slices in the plane of an image: row and column as the header has them, the distances
// of pixels, or 1 mm if it has none, with a note unless the user gave a spacing; slices 1 mm apart.
GridGeometry dicomPlane(const std::string& orientation, const std::vector<double>& pixel_spacing,
                        const OpenOptions& options, const std::string& who,
                        std::vector<std::string>& notes);

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
