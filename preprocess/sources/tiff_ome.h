// The XML of OME-TIFF. Private to preprocess/sources/.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace isobrick {

// Planes that lie one behind the other, in the order of their image.
struct OmeRun {
  std::optional<std::int64_t> ifd;             // number of the first one's page
  std::optional<std::int64_t> count;           // of planes
  std::array<std::int64_t, 3> first{0, 0, 0};  // along Z, C and T
  std::string uuid, file;                      // of the file that has them; empty: this one
};

struct OmeImage {
  std::string name;
  std::string order;                           // "XYZCT"
  std::array<std::int64_t, 2> pixels{0, 0};    // along X and Y; 0: not stated
  std::array<std::int64_t, 3> sizes{0, 0, 0};  // along Z, C and T; 0: not stated
  std::int64_t samples = 1;                    // channels that are numbers of one pixel
  std::array<std::string, 3> spacing, units;   // along X, Y and Z; empty: not stated
  bool has_mixed_axis = false;                 // Z, C or T holds another axis, too
  std::vector<OmeRun> runs;
};

struct OmeDocument {
  std::string uuid;           // of the file
  std::string metadata_file;  // which has the description in place of this one
  std::vector<OmeImage> images;
};

// As far as it is XML; nothing if `text` is none of OME.
std::optional<OmeDocument> readOme(const std::string& text);

}  // namespace isobrick
