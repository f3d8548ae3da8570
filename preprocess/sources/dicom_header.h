// The top level of a DICOM file and the functional groups of its frames, read without GDCM. Private
// to preprocess/sources/.
//
// GDCM fills missing pixels of a file that was cut short with zeros, aborts the process on some
// damaged headers, and wants the types of the standard. So every file is walked element by element,
// and GDCM gets only packed pixels that are whole, with a header of our own.
//
// Old files may lack the 128 bytes and "DICM" in front and begin with their first element, of group
// 2 or 8. Such a file counts as DICOM only if it can be walked as a data set, its tags ascending,
// up to its pixels: anything may begin with these bytes.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace isobrick {

// Tells whether a file is still the one that was read.
struct FileStamp {
  std::uint64_t bytes = 0;
  std::int64_t changed_seconds = 0, changed_nanoseconds = 0;
  bool operator==(const FileStamp&) const = default;
};

// All zeros if the file is gone.
FileStamp fileStamp(const std::string& path);

// By tag (group << 16 | element), without padding. Binary numbers are written out in decimal,
// several with a backslash between them, those of SS and SL without their sign; of an attribute tag
// the number that it is.
using DicomValues = std::map<std::uint32_t, std::string>;

struct DicomHeader {
  enum class State {
    kNotDicom,  // no "DICM" at byte 128, and no data set with pixels from byte 0 on
    kNoImage,   // DICOM, but without pixels: a directory, a report, ...
    kDamaged,   // ends early or cannot be walked
    kImage,     // whole
  };

  State state = State::kNotDicom;
  FileStamp stamp;     // of the file, from before it was walked
  DicomValues values;  // short elements before the pixels

  // An enhanced file states the place of each frame and the meaning of its numbers: elements that
  // all frames share, and those of each. Only elements that isobrick reads; at most as many frames
  // as the file has.
  DicomValues shared;
  std::vector<DicomValues> frames;
  bool hasGroups() const { return !shared.empty() || !frames.empty(); }
  std::vector<DicomValues> dimensions;  // of kDimensionIndices

  // The place of the pixels: as they lie in the file, or packed, with the marks between fragments.
  std::uint64_t pixels_at = 0, pixel_bytes = 0, packed_bytes = 0;

  // "" if there is no such element.
  std::string value(std::uint32_t tag) const {
    const auto found = values.find(tag);
    return found == values.end() ? "" : found->second;
  }
  // The value of a frame, counted from 0: its own, or else that of all frames, or else the file's.
  std::string value(std::uint32_t tag, std::size_t frame) const {
    if (frame < frames.size())
      if (const auto own = frames[frame].find(tag); own != frames[frame].end()) return own->second;
    const auto found = shared.find(tag);
    return found == shared.end() ? value(tag) : found->second;
  }
};

// Throws Error if the file cannot be opened; damage is a state.
DicomHeader readDicomHeader(const std::string& path);

// How often readDicomHeader() was called in this process: every file of a series costs one.
std::uint64_t dicomHeadersRead();

}  // namespace isobrick
