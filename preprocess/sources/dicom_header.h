// The top level of a DICOM file, read without GDCM. Private to preprocess/sources/.
//
// GDCM fills missing pixels of a file that was cut short with zeros, and aborts the process on some
// damaged headers. So every file is walked element by element first; GDCM sees only those that are
// whole.
//
// Old files may lack the 128 bytes and "DICM" in front and begin with their first element, of group
// 2 or 8. Such a file counts as DICOM only where it can be walked as a data set, its tags
// ascending, up to its pixels: anything may begin with these bytes.
#pragma once

#include <cstdint>
#include <map>
#include <string>

namespace isobrick {

// Tells whether a file is still the one that was looked at.
struct FileStamp {
  std::uint64_t bytes = 0;
  std::int64_t changed_seconds = 0, changed_nanoseconds = 0;
  bool operator==(const FileStamp&) const = default;
};

// All zeros where the file is gone.
FileStamp fileStamp(const std::string& path);

struct DicomHeader {
  enum class State {
    kNotDicom,  // no "DICM" at byte 128, and no data set with pixels from byte 0 on
    kNoImage,   // DICOM, but without pixels: a directory, a report, ...
    kDamaged,   // ends early or cannot be walked
    kImage,     // whole
  };

  State state = State::kNotDicom;
  FileStamp stamp;  // of the file, from before it was walked
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

// How often readDicomHeader() was called in this process: every file of a series costs one.
std::uint64_t dicomHeadersRead();

}  // namespace isobrick
