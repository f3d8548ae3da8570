// The elements of a DICOM file that isobrick looks at, by tag (group << 16 | element). Private to
// preprocess/sources/.
#pragma once

#include <cstdint>

namespace isobrick::dicom {

inline constexpr std::uint32_t kTransferSyntax = 0x00020010;
inline constexpr std::uint32_t kRecognitionCode = 0x00080010;  // retired

inline constexpr std::uint32_t kSliceThickness = 0x00180050;
inline constexpr std::uint32_t kSpacingBetweenSlices = 0x00180088;
inline constexpr std::uint32_t kImagerPixelSpacing = 0x00181164;

inline constexpr std::uint32_t kSeriesUid = 0x0020000e;
inline constexpr std::uint32_t kInstanceNumber = 0x00200013;
inline constexpr std::uint32_t kImagePosition = 0x00200032;
inline constexpr std::uint32_t kImageOrientation = 0x00200037;

inline constexpr std::uint32_t kSamplesPerPixel = 0x00280002;
inline constexpr std::uint32_t kPhotometricInterpretation = 0x00280004;
inline constexpr std::uint32_t kPlanarConfiguration = 0x00280006;
inline constexpr std::uint32_t kNumberOfFrames = 0x00280008;
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
inline constexpr std::uint32_t kWindowCenter = 0x00281050;
inline constexpr std::uint32_t kRescaleIntercept = 0x00281052;
inline constexpr std::uint32_t kRescaleSlope = 0x00281053;

inline constexpr std::uint32_t kPixelData = 0x7fe00010;
inline constexpr std::uint32_t kItem = 0xfffee000;
inline constexpr std::uint32_t kItemEnd = 0xfffee00d;
inline constexpr std::uint32_t kSequenceEnd = 0xfffee0dd;

}  // namespace isobrick::dicom
