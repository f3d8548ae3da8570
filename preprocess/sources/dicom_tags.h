// The elements of a DICOM file that isobrick reads, by tag (group << 16 | element). Private to
// preprocess/sources/.
#pragma once

#include <cstdint>

namespace isobrick::dicom {

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

}  // namespace isobrick::dicom
