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

// The elements of a DICOM file that isobrick reads, by tag (group << 16 | element).
namespace dicom {

inline constexpr std::uint32_t kTransferSyntax = 0x00020010;
inline constexpr std::uint32_t kImageKind = 0x00080016;  // "SOP class"
inline constexpr std::uint32_t kSeriesDescription = 0x0008103e;

inline constexpr std::uint32_t kSliceThickness = 0x00180050;
inline constexpr std::uint32_t kSpacingBetweenSlices = 0x00180088;
inline constexpr std::uint32_t kFrameTime = 0x00181063;
inline constexpr std::uint32_t kFrameTimeVector = 0x00181065;
inline constexpr std::uint32_t kNominalPixelSpacing = 0x00182010;
inline constexpr std::uint32_t kImagerPixelSpacing = 0x00181164;

inline constexpr std::uint32_t kSeriesUid = 0x0020000e;
inline constexpr std::uint32_t kSeriesNumber = 0x00200011;
inline constexpr std::uint32_t kInstanceNumber = 0x00200013;
inline constexpr std::uint32_t kImagePosition = 0x00200032;
inline constexpr std::uint32_t kImageOrientation = 0x00200037;
inline constexpr std::uint32_t kTemporalPosition = 0x00200100;

inline constexpr std::uint32_t kSamplesPerPixel = 0x00280002;
inline constexpr std::uint32_t kPhotometricInterpretation = 0x00280004;
inline constexpr std::uint32_t kPlanarConfiguration = 0x00280006;
inline constexpr std::uint32_t kNumberOfFrames = 0x00280008;
inline constexpr std::uint32_t kFrameIncrementPointer = 0x00280009;
inline constexpr std::uint32_t kRows = 0x00280010;
inline constexpr std::uint32_t kColumns = 0x00280011;
inline constexpr std::uint32_t kPixelSpacing = 0x00280030;
inline constexpr std::uint32_t kBitsAllocated = 0x00280100;
inline constexpr std::uint32_t kBitsStored = 0x00280101;
inline constexpr std::uint32_t kHighBit = 0x00280102;
inline constexpr std::uint32_t kPixelRepresentation = 0x00280103;
inline constexpr std::uint32_t kSmallestPixel = 0x00280106;
inline constexpr std::uint32_t kLargestPixel = 0x00280107;
inline constexpr std::uint32_t kPadding = 0x00280120;
inline constexpr std::uint32_t kPaddingRangeLimit = 0x00280121;
inline constexpr std::uint32_t kRescaleIntercept = 0x00281052;
inline constexpr std::uint32_t kRescaleSlope = 0x00281053;

inline constexpr std::uint32_t kTotalPixelMatrixColumns = 0x00480006;

// Enhanced files: the functional groups, shared and of each frame, the sequences in them that are
// of interest, and the elements in these.
inline constexpr std::uint32_t kSharedGroups = 0x52009229;
inline constexpr std::uint32_t kFrameGroups = 0x52009230;
inline constexpr std::uint32_t kFrameContent = 0x00209111;
inline constexpr std::uint32_t kPlanePosition = 0x00209113;
inline constexpr std::uint32_t kPlaneOrientation = 0x00209116;
inline constexpr std::uint32_t kPixelMeasures = 0x00289110;
inline constexpr std::uint32_t kPixelValueTransformation = 0x00289145;
inline constexpr std::uint32_t kStackId = 0x00209056;
inline constexpr std::uint32_t kInStackPosition = 0x00209057;
inline constexpr std::uint32_t kTemporalPositionIndex = 0x00209128;
inline constexpr std::uint32_t kDimensionIndexValues = 0x00209157;
// Which dimensions the index values of a frame are of.
inline constexpr std::uint32_t kDimensionIndices = 0x00209222;
inline constexpr std::uint32_t kDimensionIndexPointer = 0x00209165;

inline constexpr std::uint32_t kDetectorInformation = 0x00540022;

inline constexpr std::uint32_t kGridFrameOffsets = 0x3004000c;
inline constexpr std::uint32_t kDoseScale = 0x3004000e;

inline constexpr std::uint32_t kPixelData = 0x7fe00010;
inline constexpr std::uint32_t kItem = 0xfffee000;
inline constexpr std::uint32_t kItemEnd = 0xfffee00d;
inline constexpr std::uint32_t kSequenceEnd = 0xfffee0dd;

// Transfer syntaxes: how the elements and the pixels are encoded.
inline constexpr const char* kImplicit = "1.2.840.10008.1.2";
inline constexpr const char* kExplicit = "1.2.840.10008.1.2.1";
inline constexpr const char* kDeflated = "1.2.840.10008.1.2.1.99";
inline constexpr const char* kBigEndian = "1.2.840.10008.1.2.2";
inline constexpr const char* kImplicitOfGe = "1.2.840.113619.5.2";  // the pixels big-endian

inline constexpr const char* kMrImage = "1.2.840.10008.5.1.4.1.1.4";

}  // namespace dicom

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
