#include "isobrick/preprocess/sources/dicom_header.h"

#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdlib>
#include <fstream>
#include <string_view>

#include "isobrick/preprocess/byte_order.h"
#include "isobrick/preprocess/sources/dicom_tags.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"

namespace isobrick {
namespace {

constexpr std::uint32_t kUndefinedLength = 0xffffffff;
constexpr int kMostNesting = 32;
constexpr std::uint32_t kMostValueBytes = 1024;  // longer values are of no interest here
constexpr std::uint32_t kMostOffsetBytes = 1 << 20;
constexpr std::size_t kMostDimensions = 64;

// Types of values ("value representations") with a length of four and of two bytes.
constexpr std::array<std::string_view, 13> kLongTypes = {"OB", "OD", "OF", "OL", "OV", "OW", "SQ",
                                                         "SV", "UC", "UN", "UR", "UT", "UV"};
constexpr std::array<std::string_view, 21> kShortTypes = {"AE", "AS", "AT", "CS", "DA", "DS", "DT",
                                                          "FD", "FL", "IS", "LO", "LT", "PN", "SH",
                                                          "SL", "SS", "ST", "TM", "UI", "UL", "US"};

// Elements that are one 16-bit number in every file that GDCM can work with.
constexpr std::array<std::uint32_t, 8> kNumbers = {
    dicom::kSamplesPerPixel, dicom::kPlanarConfiguration, dicom::kRows,
    dicom::kColumns,         dicom::kBitsAllocated,       dicom::kBitsStored,
    dicom::kHighBit,         dicom::kPixelRepresentation};

// Sequences with elements of interest in an item of the functional groups, and these elements.
constexpr std::array<std::uint32_t, 5> kGroupSequences = {
    dicom::kFrameContent, dicom::kPlanePosition, dicom::kPlaneOrientation, dicom::kPixelMeasures,
    dicom::kPixelValueTransformation};
constexpr std::array<std::uint32_t, 12> kGroupValues = {
    dicom::kStackId,          dicom::kInStackPosition,      dicom::kTemporalPositionIndex,
    dicom::kImagePosition,    dicom::kDimensionIndexValues, dicom::kImageOrientation,
    dicom::kSliceThickness,   dicom::kSpacingBetweenSlices, dicom::kPixelSpacing,
    dicom::kRescaleIntercept, dicom::kRescaleSlope,         dicom::kDimensionIndexPointer};

// Numbers of 32 bits; implicit encoding does not state their type.
constexpr std::array<std::uint32_t, 3> kLongNumbers = {
    dicom::kInStackPosition, dicom::kTemporalPositionIndex, dicom::kDimensionIndexValues};

bool isOneOf(const auto& all, const auto& one) {
  return std::find(all.begin(), all.end(), one) != all.end();
}

std::atomic<std::uint64_t> headers_read{0};

// The file ends early, or its content makes no sense.
struct Damaged {};

struct Encoding {
  bool is_explicit = true;
  bool big_endian = false;
};

struct Element {
  std::uint32_t tag = 0;
  std::string representation;  // "US", ...; empty in implicit encoding and for items
  std::uint32_t length = 0;
};

class Walker {
 public:
  explicit Walker(const std::string& path) : in_(path, std::ios::binary) {
    if (!in_)
      throw Error("cannot open '" + path + "'; check the path and its permissions", {.path = path});
    size_ = fileBytes(path);
  }

  DicomHeader walk() {
    DicomHeader header;
    constexpr std::uint64_t kPreambleBytes = 128;
    if (size_ >= kPreambleBytes + 4) {
      seek(kPreambleBytes);
      if (bytes(4) == "DICM") {
        try {
          header.state =
              walkDataSet(header) ? DicomHeader::State::kImage : DicomHeader::State::kNoImage;
        } catch (const Damaged&) {
          header.state = DicomHeader::State::kDamaged;
        }
        return header;
      }
      seek(0);
    }
    walkWithoutPreamble(header);
    return header;
  }

 private:
  // Nothing but the data set itself says that the file is DICOM.
  void walkWithoutPreamble(DicomHeader& header) {
    must_ascend_ = true;
    try {
      const std::uint32_t group = peekGroup();
      if (group != 2 && group != 8) return;
      if (walkDataSet(header)) header.state = DicomHeader::State::kImage;
    } catch (const Damaged&) {
      // A file whose walk comes to the pixels of an image of some size is no other file.
      if (at_pixels_ && header.values.contains(dicom::kRows) &&
          header.values.contains(dicom::kColumns))
        header.state = DicomHeader::State::kDamaged;
    }
    if (header.state == DicomHeader::State::kNotDicom) header = {};
  }

  static std::uint32_t mostBytes(std::uint32_t tag) {
    return tag == dicom::kGridFrameOffsets ? kMostOffsetBytes : kMostValueBytes;
  }

  // True if the pixels were found, whole.
  bool walkDataSet(DicomHeader& header) {
    DicomValues& values = header.values;
    // Group 2 is always explicit little-endian and says how the rest is encoded.
    Encoding encoding;
    bool in_meta_group = true;
    std::uint32_t last_tag = 0;
    while (at_ < size_) {
      if (in_meta_group && peekGroup() != 2) {
        in_meta_group = false;
        if (!values.contains(dicom::kTransferSyntax))
          values[dicom::kTransferSyntax] = guessedSyntax();
        const std::string& syntax = values[dicom::kTransferSyntax];
        // Deflated, or big-endian without types as one maker has it: GDCM may try.
        if (syntax == "1.2.840.10008.1.2.1.99" || syntax == "1.2.840.113619.5.2") {
          if (must_ascend_) throw Damaged();
          return true;
        }
        encoding.is_explicit = syntax != "1.2.840.10008.1.2";
        encoding.big_endian = syntax == "1.2.840.10008.1.2.2";
      }
      const Element element = readElement(encoding);
      if (must_ascend_ && element.tag <= last_tag) throw Damaged();
      last_tag = element.tag;
      if (element.tag == dicom::kPixelData) {
        at_pixels_ = true;
        if (must_ascend_ && !hasSize(values)) throw Damaged();
        header.pixels_at = at_;
        checkPixels(element, values);
        if (element.length != kUndefinedLength) header.pixel_bytes = element.length;
        return true;
      }
      if (element.tag == dicom::kSharedGroups) {
        walkItems(element, encoding, [&](const Element& item, const Encoding& inner) {
          walkGroups(item, inner, header.shared);
        });
      } else if (element.tag == dicom::kFrameGroups) {
        walkList(element, encoding, numberOf(values, dicom::kNumberOfFrames, 1), header.frames);
      } else if (element.tag == dicom::kDimensionIndices) {
        walkList(element, encoding, kMostDimensions, header.dimensions);
      } else if (element.length == kUndefinedLength || element.length > mostBytes(element.tag)) {
        skipValue(element, encoding, 0);
      } else {
        values[element.tag] = text(element, encoding);
        // The retired "recognition code"; GDCM aborts on any that it does not support.
        if (element.tag == dicom::kRecognitionCode && !values[element.tag].starts_with("ACR"))
          throw Damaged();
      }
    }
    return false;
  }

  // Without group 2: the two encodings that old files have differ in the bytes behind the tag.
  std::string guessedSyntax() {
    if (!must_ascend_) return "";
    const std::uint64_t here = at_;
    skip(4);
    const std::string type = bytes(2);
    seek(here);
    const bool is_explicit = isOneOf(kLongTypes, type) || isOneOf(kShortTypes, type);
    return is_explicit ? "1.2.840.10008.1.2.1" : "1.2.840.10008.1.2";
  }

  static bool hasSize(const DicomValues& values) {
    return numberOf(values, dicom::kRows, 0) > 0 && numberOf(values, dicom::kColumns, 0) > 0;
  }

  static std::uint64_t numberOf(const DicomValues& values, std::uint32_t tag,
                                std::uint64_t otherwise) {
    const auto found = values.find(tag);
    return found == values.end() ? otherwise : std::strtoull(found->second.c_str(), nullptr, 10);
  }

  void checkPixels(const Element& element, const DicomValues& values) {
    if (element.length == kUndefinedLength) {  // compressed: fragments up to an end mark
      for (;;) {
        const Element item = readElement({false, false});
        if (item.tag == dicom::kSequenceEnd) return;
        if (item.tag != dicom::kItem || item.length == kUndefinedLength) throw Damaged();
        skip(item.length);
      }
    }
    // Clamped so that the product fits 64 bits: 16 + 16 + 2 + 20 + 6 bits.
    const auto clamped = [&](std::uint32_t tag, std::uint64_t otherwise, std::uint64_t most) {
      return std::min<std::uint64_t>(numberOf(values, tag, otherwise), most);
    };
    const std::uint64_t bits =
        clamped(dicom::kRows, 0, 65535) * clamped(dicom::kColumns, 0, 65535) *
        clamped(dicom::kSamplesPerPixel, 1, 4) * clamped(dicom::kNumberOfFrames, 1, 1u << 20) *
        clamped(dicom::kBitsAllocated, 16, 64);
    if (element.length < bits / 8) throw Damaged();
    skip(element.length);
  }

  // The content of an element without a type may be written in another encoding than the rest.
  static Encoding innerEncoding(const Element& element, const Encoding& outer) {
    return element.representation == "UN" ? Encoding{false, false} : outer;
  }

  // Calls `f` behind the head of each element of a sequence or an item of this length; `f` goes on
  // behind its value.
  template <typename F>
  void forEachElement(std::uint32_t length, std::uint32_t end_mark, const Encoding& encoding, F f) {
    const bool is_open = length == kUndefinedLength;
    if (!is_open && length > size_ - at_) throw Damaged();
    const std::uint64_t end = is_open ? size_ : at_ + length;
    while (is_open || at_ < end) {
      const Element element = readElement(encoding);
      if (is_open && element.tag == end_mark) return;
      f(element);
      if (at_ > end) throw Damaged();
    }
  }

  // Calls `f` behind the head of each item of a sequence, with the encoding of its content.
  template <typename F>
  void walkItems(const Element& sequence, const Encoding& outer, F f) {
    const Encoding encoding = innerEncoding(sequence, outer);
    forEachElement(sequence.length, dicom::kSequenceEnd, encoding, [&](const Element& item) {
      if (item.tag != dicom::kItem) throw Damaged();
      f(item, encoding);
    });
  }

  // A sequence of at most so many items, each with elements of interest.
  void walkList(const Element& sequence, const Encoding& encoding, std::uint64_t most,
                std::vector<DicomValues>& list) {
    walkItems(sequence, encoding, [&](const Element& item, const Encoding& inner) {
      if (list.size() >= most) throw Damaged();
      walkGroups(item, inner, list.emplace_back());
    });
  }

  // An item of the functional groups: the elements of interest in it, and in the sequences in it.
  void walkGroups(const Element& item, const Encoding& encoding, DicomValues& values) {
    forEachElement(item.length, dicom::kItemEnd, encoding, [&](const Element& element) {
      if (isOneOf(kGroupSequences, element.tag))
        walkItems(element, encoding, [&](const Element& group, const Encoding& inner) {
          forEachElement(group.length, dicom::kItemEnd, inner,
                         [&](const Element& one) { takeGroupValue(one, inner, values); });
        });
      else
        takeGroupValue(element, encoding, values);
    });
  }

  void takeGroupValue(const Element& element, const Encoding& encoding, DicomValues& values) {
    if (isOneOf(kGroupValues, element.tag) && element.length <= kMostValueBytes)
      values[element.tag] = text(element, encoding);
    else
      skipValue(element, encoding, 1);
  }

  void skipValue(const Element& element, const Encoding& encoding, int depth) {
    if (element.length != kUndefinedLength) return skip(element.length);
    if (depth > kMostNesting) throw Damaged();
    walkItems(element, encoding, [&](const Element& item, const Encoding& inner) {
      if (item.length != kUndefinedLength) return skip(item.length);
      forEachElement(item.length, dicom::kItemEnd, inner,
                     [&](const Element& one) { skipValue(one, inner, depth + 1); });
    });
  }

  Element readElement(const Encoding& encoding) {
    Element element;
    const std::uint32_t group = number16(encoding.big_endian);
    element.tag = group << 16 | number16(encoding.big_endian);
    if (!encoding.is_explicit || group == 0xfffe) {  // items have no type in any encoding
      element.length = number32(encoding.big_endian);
      if (isOneOf(kNumbers, element.tag) && element.length != 2) throw Damaged();
      return element;
    }
    element.representation = bytes(2);
    if (isOneOf(kLongTypes, element.representation)) {
      skip(2);
      element.length = number32(encoding.big_endian);
    } else {
      if (!isOneOf(kShortTypes, element.representation)) throw Damaged();
      element.length = number16(encoding.big_endian);
    }
    checkTypeOfImageElement(element);
    return element;
  }

  // GDCM aborts if an element that it uses has another type than the standard gives it.
  static void checkTypeOfImageElement(const Element& element) {
    static constexpr std::array<std::uint32_t, 9> kDecimals = {
        dicom::kSliceThickness, dicom::kSpacingBetweenSlices, dicom::kImagerPixelSpacing,
        dicom::kImagePosition,  dicom::kImageOrientation,     dicom::kPixelSpacing,
        dicom::kWindowCenter,   dicom::kRescaleIntercept,     dicom::kRescaleSlope};
    const std::string& type = element.representation;
    if (isOneOf(kNumbers, element.tag) && (type != "US" || element.length != 2)) throw Damaged();
    if (isOneOf(kDecimals, element.tag) && type != "DS") throw Damaged();
    if (element.tag == dicom::kNumberOfFrames && type != "IS") throw Damaged();
    if (element.tag == dicom::kPhotometricInterpretation && type != "CS") throw Damaged();
    if (element.tag == dicom::kPixelData && type != "OW" && type != "OB") throw Damaged();
  }

  std::string text(const Element& element, const Encoding& encoding) {
    // Implicit encoding has no types: those of group 28 that are of interest are known numbers.
    const std::uint32_t tag = element.tag;
    const bool is_number = element.representation == "US" || element.representation == "SS" ||
                           (!encoding.is_explicit && (tag >> 16) == 0x0028 && element.length == 2 &&
                            tag != dicom::kNumberOfFrames && tag <= dicom::kPaddingRangeLimit);
    if (is_number && element.length == 2) return std::to_string(number16(encoding.big_endian));
    if (isOneOf(kLongNumbers, tag)) return numbersText(element.length, encoding);
    if ((tag == dicom::kDimensionIndexPointer || tag == dicom::kFrameIncrementPointer) &&
        element.length == 4) {
      const std::uint32_t group = number16(encoding.big_endian);
      return std::to_string(group << 16 | number16(encoding.big_endian));
    }
    std::string value = bytes(element.length);
    while (!value.empty() && (value.back() == ' ' || value.back() == '\0')) value.pop_back();
    const std::size_t first = value.find_first_not_of(' ');
    return first == std::string::npos ? "" : value.substr(first);
  }

  std::string numbersText(std::uint32_t length, const Encoding& encoding) {
    if (length % 4 != 0) throw Damaged();
    std::string text;
    for (std::uint32_t i = 0; i < length / 4; ++i) {
      if (i > 0) text += '\\';
      text += std::to_string(number32(encoding.big_endian));
    }
    return text;
  }

  std::uint32_t peekGroup() {
    const std::uint64_t here = at_;
    const std::uint32_t group = number16(false);
    seek(here);
    return group;
  }

  std::uint32_t number16(bool big_endian) {
    return loadNumber<std::uint16_t>(bytes(2).data(), big_endian);
  }
  std::uint32_t number32(bool big_endian) {
    return loadNumber<std::uint32_t>(bytes(4).data(), big_endian);
  }

  std::string bytes(std::uint32_t count) {
    if (count > size_ - at_) throw Damaged();
    std::string result(count, '\0');
    in_.read(result.data(), static_cast<std::streamsize>(count));
    if (!in_) throw Damaged();
    at_ += count;
    return result;
  }
  void skip(std::uint64_t count) {
    if (count > size_ - at_) throw Damaged();
    // A seek drops the bytes that were read ahead.
    constexpr std::uint64_t kFewBytes = 4096;
    if (count > kFewBytes) return seek(at_ + count);
    in_.ignore(static_cast<std::streamsize>(count));
    at_ += count;
  }
  void seek(std::uint64_t position) {
    in_.seekg(static_cast<std::streamoff>(position));
    at_ = position;
  }

  std::ifstream in_;
  std::uint64_t size_ = 0;
  std::uint64_t at_ = 0;  // <= size_
  bool must_ascend_ = false;
  bool at_pixels_ = false;
};

}  // namespace

FileStamp fileStamp(const std::string& path) {
  struct stat status = {};
  if (stat(path.c_str(), &status) != 0) return {};
  return {static_cast<std::uint64_t>(status.st_size), status.st_mtim.tv_sec,
          status.st_mtim.tv_nsec};
}

DicomHeader readDicomHeader(const std::string& path) {
  headers_read.fetch_add(1, std::memory_order_relaxed);
  const FileStamp stamp = fileStamp(path);
  DicomHeader header = Walker(path).walk();
  header.stamp = stamp;
  return header;
}

std::uint64_t dicomHeadersRead() { return headers_read.load(std::memory_order_relaxed); }

}  // namespace isobrick
