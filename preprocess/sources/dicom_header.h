// The top level of a DICOM file, read without GDCM. Private to preprocess/sources/.
//
// GDCM fills missing pixels of a file that was cut short with zeros, and aborts the process on some
// damaged headers. So every file is walked element by element first; GDCM sees only those that are
// whole.
#pragma once

#include <cstdint>
#include <map>
#include <string>

namespace isobrick {

struct DicomHeader {
  enum class State {
    kNotDicom,  // no "DICM" at byte 128
    kNoImage,   // DICOM, but without pixels: a directory, a report, ...
    kDamaged,   // ends early or cannot be walked
    kImage,     // whole
  };

  State state = State::kNotDicom;
  // Short elements before the pixels, by tag (group << 16 | element), without padding. Numbers of
  // type US and SS are written out in decimal.
  std::map<std::uint32_t, std::string> values;

  // "" where there is no such element.
  std::string value(std::uint32_t tag) const {
    const auto found = values.find(tag);
    return found == values.end() ? "" : found->second;
  }
};

// Throws Error where the file cannot be opened; damage is a state.
DicomHeader readDicomHeader(const std::string& path);

}  // namespace isobrick
