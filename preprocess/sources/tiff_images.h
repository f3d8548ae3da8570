// The volumes that the pages of a TIFF file are. Private to preprocess/sources/.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/preprocess/sources/tiff_file.h"
#include "isobrick/storage/grid.h"

namespace isobrick {

// An axis of planes: 'Z', 'C' (channels), 'T' (times), or a letter of unknown meaning.
struct TiffAxis {
  char name = 'Z';
  std::int64_t count = 1;
};

// Lengths as the file states them.
struct TiffLengths {
  glm::dvec3 spacing{0.0};  // 0: not stated
  std::array<std::string, 3> units;
};

struct TiffImage {
  std::string name;
  std::vector<TiffAxis> axes;    // of its planes, the slowest first
  std::vector<TiffPage> planes;  // one without width is in no file
  bool has_channels = false;     // the numbers of a pixel are channels
  std::string unread;            // why it cannot be read; empty: it can
  std::string lacks;             // a file with some planes that is not there
  TiffLengths lengths;
  std::vector<VolumeChannel> named_channels = {};
};

struct TiffImages {
  std::vector<std::string> paths;  // of the files that the planes are in, the first one's first
  std::vector<TiffImage> images;
};

// The images of a file by its description: hyperstacks of ImageJ (also with one page for all
// planes), OME-TIFF (also of several files), series of tifffile, Zeiss LSM; otherwise pages of one
// form are the slices of an image. Smaller pictures beside the pages are left out. Throws Error
// that names the file if its description contradicts its pages.
TiffImages findTiffImages(const std::string& path, const OpenOptions& options);

// The lengths that a first page states: those of OME-TIFF, ImageJ or Zeiss LSM, or the resolution
// in pixels an inch, a centimetre or a unit.
TiffLengths tiffLengths(const TiffResolution& said, const std::string& description);

// Whether it is that of an OME-TIFF of several files.
bool namesOtherFiles(const std::string& description);

}  // namespace isobrick
