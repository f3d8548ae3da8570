#include "isobrick/preprocess/sources/dicom_header.h"

#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <string_view>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/dicom_header.h"
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

// Numbers of 16 bits. Their type is not stated in implicit encoding, and is wrong in many files.
constexpr std::array<std::uint32_t, 12> kNumbers = {dicom::kSamplesPerPixel,
                                                    dicom::kPlanarConfiguration,
                                                    dicom::kRows,
                                                    dicom::kColumns,
                                                    dicom::kBitsAllocated,
                                                    dicom::kBitsStored,
                                                    dicom::kHighBit,
                                                    dicom::kPixelRepresentation,
                                                    dicom::kSmallestPixel,
                                                    dicom::kLargestPixel,
                                                    dicom::kPadding,
                                                    dicom::kPaddingRangeLimit};

// Sequences with elements of interest in an item of the functional groups, and these elements.
constexpr std::array<std::uint32_t, 5> kGroupSequences = {
    dicom::kFrameContent, dicom::kPlanePosition, dicom::kPlaneOrientation, dicom::kPixelMeasures,
    dicom::kPixelValueTransformation};
constexpr std::array<std::uint32_t, 12> kGroupValues = {
    dicom::kStackId,          dicom::kInStackPosition,      dicom::kTemporalPositionIndex,
    dicom::kImagePosition,    dicom::kDimensionIndexValues, dicom::kImageOrientation,
    dicom::kSliceThickness,   dicom::kSpacingBetweenSlices, dicom::kPixelSpacing,
    dicom::kRescaleIntercept, dicom::kRescaleSlope,         dicom::kDimensionIndexPointer};

// Numbers of 32 bits.
constexpr std::array<std::uint32_t, 3> kLongNumbers = {
    dicom::kInStackPosition, dicom::kTemporalPositionIndex, dicom::kDimensionIndexValues};

bool isOneOf(const auto& all, const auto& one) { return std::ranges::find(all, one) != all.end(); }

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
    if (!in_) throw fileError(path, "cannot open '", path, "'; check the path and its permissions");
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
        if (syntax == dicom::kDeflated) {
          if (must_ascend_) throw Damaged();
          return true;
        }
        encoding.is_explicit = syntax != dicom::kImplicit && syntax != dicom::kImplicitOfGe;
        encoding.big_endian = syntax == dicom::kBigEndian;
      }
      const Element element = readElement(encoding);
      if (must_ascend_ && element.tag <= last_tag) throw Damaged();
      last_tag = element.tag;
      if (element.tag == dicom::kPixelData) {
        at_pixels_ = true;
        if (must_ascend_ && !hasSize(values)) throw Damaged();
        header.pixels_at = at_;
        checkPixels(element, values);
        (element.length == kUndefinedLength ? header.packed_bytes : header.pixel_bytes) =
            at_ - header.pixels_at;
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
      } else if (element.tag == dicom::kDetectorInformation) {
        // Where the first frame of nuclear medicine is.
        DicomValues places;
        walkItems(element, encoding, [&](const Element& item, const Encoding& inner) {
          walkGroups(item, inner, places);
        });
        values.merge(places);
      } else if (element.length == kUndefinedLength || element.length > mostBytes(element.tag)) {
        skipValue(element, encoding, 0);
      } else {
        values[element.tag] = text(element, encoding);
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
    return is_explicit ? dicom::kExplicit : dicom::kImplicit;
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
      return element;
    }
    element.representation = bytes(2);
    if (isOneOf(kLongTypes, element.representation)) {
      skip(2);
      element.length = number32(encoding.big_endian);
    } else {
      element.length = number16(encoding.big_endian);
      if (!isOneOf(kShortTypes, element.representation)) findLength(element, encoding);
    }
    return element;
  }

  // Of an element of no known type: most writers of such put a length of two bytes behind it, as
  // they do behind most types; some leave the type out. What follows must be an element.
  void findLength(Element& element, const Encoding& encoding) {
    if (must_ascend_) throw Damaged();
    const std::uint64_t behind_short = at_;
    if (isElementAt(at_ + element.length, element.tag, encoding)) return;
    seek(behind_short - 4);
    element.length = number32(encoding.big_endian);
    if (isElementAt(at_ + element.length, element.tag, encoding)) return;
    if (size_ - at_ < 4) throw Damaged();
    seek(behind_short);
    element.length = number32(encoding.big_endian);
    if (!isElementAt(at_ + element.length, element.tag, encoding)) throw Damaged();
  }

  // Whether an element of a greater tag may begin there, or an item end; or the file ends.
  bool isElementAt(std::uint64_t place, std::uint32_t behind, const Encoding& encoding) {
    if (place == size_) return true;
    if (place > size_ || size_ - place < 8) return false;
    const std::uint64_t here = at_;
    seek(place);
    const std::uint32_t group = number16(encoding.big_endian);
    const std::uint32_t tag = group << 16 | number16(encoding.big_endian);
    const std::string type = bytes(2);
    seek(here);
    if (group == 0xfffe) return true;
    const auto isLetter = [](char c) { return c >= 'A' && c <= 'Z'; };
    const bool is_typed = isLetter(type[0]) && isLetter(type[1]);
    // Of the same group if that is private: another one may lack its type too.
    return tag > behind && (is_typed || (group % 2 == 1 && group == behind >> 16));
  }

  // As the type says. Without one, or with that of bytes, as the standard has the element.
  std::string text(const Element& element, const Encoding& encoding) {
    const std::string& type = element.representation;
    const std::uint32_t tag = element.tag;
    const bool is_typed = isOneOf(kShortTypes, type);
    if (type == "FD" || type == "FL") return floatsText(element, encoding);
    if (type == "UL" || type == "SL" || (!is_typed && isOneOf(kLongNumbers, tag)))
      return numbersText(element.length, 4, encoding);
    if (type == "US" || type == "SS" || (!is_typed && isOneOf(kNumbers, tag)))
      return numbersText(element.length, 2, encoding);
    if (type == "AT" || tag == dicom::kDimensionIndexPointer ||
        tag == dicom::kFrameIncrementPointer) {
      if (element.length < 4) return bytes(element.length);
      const std::uint32_t group = number16(encoding.big_endian);
      const std::uint32_t pointed = group << 16 | number16(encoding.big_endian);
      skip(element.length - 4);
      return std::to_string(pointed);
    }
    std::string value = bytes(element.length);
    while (!value.empty() && (value.back() == ' ' || value.back() == '\0')) value.pop_back();
    const std::size_t first = value.find_first_not_of(' ');
    return first == std::string::npos ? "" : value.substr(first);
  }

  std::string numbersText(std::uint32_t length, std::uint32_t each, const Encoding& encoding) {
    if (length % each != 0) throw Damaged();
    std::string text;
    for (std::uint32_t i = 0; i < length / each; ++i) {
      if (i > 0) text += '\\';
      text +=
          std::to_string(each == 2 ? number16(encoding.big_endian) : number32(encoding.big_endian));
    }
    return text;
  }

  std::string floatsText(const Element& element, const Encoding& encoding) {
    const std::uint32_t each = element.representation == "FD" ? 8 : 4;
    if (element.length % each != 0) throw Damaged();
    std::ostringstream text;
    text.precision(17);
    for (std::uint32_t i = 0; i < element.length / each; ++i) {
      const std::string stored = bytes(each);
      if (i > 0) text << '\\';
      if (each == 8)
        text << loadNumber<double>(stored.data(), encoding.big_endian);
      else
        text << loadNumber<float>(stored.data(), encoding.big_endian);
    }
    return text.str();
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
