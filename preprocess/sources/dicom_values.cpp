#include "isobrick/preprocess/sources/dicom_values.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <sstream>

#include "isobrick/preprocess/sources/dicom_header.h"

namespace isobrick {
namespace {

// Hostile headers: enough for every sum and product here.
constexpr int kMostBits = 32;

struct Range {
  double low = std::numeric_limits<double>::infinity();
  double high = -std::numeric_limits<double>::infinity();
  void include(double value) {
    low = std::min(low, value);
    high = std::max(high, value);
  }
};

double decimal(const std::string& text, double otherwise) {
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  return end == text.c_str() || !std::isfinite(value) ? otherwise : value;
}

int bitCount(const DicomHeader& header, std::uint32_t tag, int otherwise) {
  const double bits = decimal(header.value(tag), otherwise);
  return bits >= 1 && bits <= kMostBits ? static_cast<int>(bits) : otherwise;
}

// The same 16 bits are written as US or as SS, whatever the pixels are.
std::optional<std::int64_t> pixelValue(const DicomHeader& header, std::uint32_t tag,
                                       bool is_signed) {
  const std::string text = header.value(tag);
  char* end = nullptr;
  const long value = std::strtol(text.c_str(), &end, 10);
  if (end == text.c_str() || value < 0 || value > 0xffff) return std::nullopt;
  return is_signed && value > 0x7fff ? value - 0x10000 : value;
}

void includeStored(const DicomValueMap& map, std::int64_t stored, Range& range) {
  range.include(map.slope * static_cast<double>(stored) + map.intercept);
}

Range allowedBy(const std::vector<DicomValueMap>& maps) {
  Range range;
  for (const DicomValueMap& map : maps) {
    const std::int64_t count = std::int64_t{1} << map.bits_stored;
    includeStored(map, map.is_signed ? -count / 2 : 0, range);
    includeStored(map, map.is_signed ? count / 2 - 1 : count - 1, range);
  }
  return range;
}

// Nothing unless all slices have both, in order.
std::optional<Range> claimedBy(const std::vector<DicomValueMap>& maps) {
  Range range;
  for (const DicomValueMap& map : maps) {
    if (!map.smallest || !map.largest || *map.smallest > *map.largest) return std::nullopt;
    includeStored(map, *map.smallest, range);
    includeStored(map, *map.largest, range);
  }
  return range;
}

template <typename T>
bool fits(const Range& range) {
  return range.low >= std::numeric_limits<T>::min() && range.high <= std::numeric_limits<T>::max();
}

std::optional<VoxelType> typeFor(const Range& range) {
  if (fits<std::int16_t>(range)) return VoxelType::kInt16;
  if (fits<std::uint16_t>(range)) return VoxelType::kUint16;
  return std::nullopt;
}

bool isWhole(double value) { return value == std::floor(value); }

}  // namespace

bool hasIdleRescale(const DicomHeader& header) {
  return header.value(dicom::kImageKind) == dicom::kMrImage &&
         !header.value(dicom::kRescaleSlope).empty();
}

DicomValueMap dicomValueMap(const DicomHeader& header, std::size_t frame) {
  DicomValueMap map;
  if (!hasIdleRescale(header)) {
    map.slope = decimal(header.value(dicom::kRescaleSlope, frame), 1);
    map.intercept = decimal(header.value(dicom::kRescaleIntercept, frame), 0);
  }
  if (const std::string scale = header.value(dicom::kDoseScale); !scale.empty())
    map.slope = decimal(scale, 1);
  if (map.slope == 0) map.slope = 1;
  map.bits_allocated = bitCount(header, dicom::kBitsAllocated, map.bits_allocated);
  map.bits_stored =
      std::min(bitCount(header, dicom::kBitsStored, map.bits_allocated), map.bits_allocated);
  map.high_bit = bitCount(header, dicom::kHighBit, map.bits_stored - 1);
  if (map.high_bit < map.bits_stored - 1 || map.high_bit >= map.bits_allocated)
    map.high_bit = map.bits_stored - 1;
  map.is_signed = decimal(header.value(dicom::kPixelRepresentation), 0) == 1;
  map.smallest = pixelValue(header, dicom::kSmallestPixel, map.is_signed);
  map.largest = pixelValue(header, dicom::kLargestPixel, map.is_signed);
  map.padding = pixelValue(header, dicom::kPadding, map.is_signed);
  return map;
}

std::vector<double> decimalStrings(const std::string& text, std::size_t count) {
  std::vector<double> values;
  const char* at = text.c_str();
  for (;;) {
    char* end = nullptr;
    const double value = std::strtod(at, &end);
    if (end == at || !std::isfinite(value)) break;
    values.push_back(value);
    at = end;
    while (*at == ' ') ++at;
    if (*at != '\\') break;
    ++at;
  }
  if (values.size() != count) values.clear();
  return values;
}

void noteValueMaps(const std::vector<DicomValueMap>& maps, std::vector<std::string>& notes) {
  const auto differs = [&](const DicomValueMap& map) {
    return map.slope != maps.front().slope || map.intercept != maps.front().intercept;
  };
  if (std::ranges::any_of(maps, differs))
    notes.push_back("rescale slope and intercept, which differ, were applied to each frame");
  else if (maps.front().slope != 1 || maps.front().intercept != 0)
    notes.push_back("rescale slope and intercept were applied to the stored values");
}

void noteMonochrome1(const std::string& photometric, std::vector<std::string>& notes) {
  if (photometric == "MONOCHROME1")
    notes.push_back(
        "MONOCHROME1: least values are meant to be the brightest; they were kept as stored");
}

DicomVoxelType dicomVoxelType(const std::vector<DicomValueMap>& maps) {
  const auto all = [&](auto&& holds) { return std::ranges::all_of(maps, holds); };
  if (!all([](const DicomValueMap& m) { return isWhole(m.slope) && isWhole(m.intercept); }))
    return {VoxelType::kFloat32, "slope or intercept is no whole number: values became float32"};
  const auto isByte = [&](const DicomValueMap& m) {
    return m.bits_allocated == 8 && m.slope == 1 && m.intercept == 0 &&
           m.is_signed == maps.front().is_signed;
  };
  if (all(isByte)) return {maps.front().is_signed ? VoxelType::kInt8 : VoxelType::kUint8, ""};
  const Range allowed = allowedBy(maps);
  if (const auto type = typeFor(allowed)) return {*type, ""};

  Range padding;
  for (const DicomValueMap& map : maps)
    if (map.padding) includeStored(map, *map.padding, padding);
  std::optional<Range> claimed = claimedBy(maps);
  const bool has_padding = padding.low <= padding.high;
  if (claimed && has_padding) {
    claimed->include(padding.low);
    claimed->include(padding.high);
  }
  const bool is_shifted_only =
      all([](const DicomValueMap& m) { return m.bits_stored <= 16 && std::abs(m.slope) == 1; });
  if (claimed) {
    if (const auto type = typeFor(*claimed)) return {*type, ""};
  } else if (is_shifted_only) {
    const VoxelType likely = allowed.low < 0 ? VoxelType::kInt16 : VoxelType::kUint16;
    const bool padding_fits =
        likely == VoxelType::kInt16 ? fits<std::int16_t>(padding) : fits<std::uint16_t>(padding);
    if (!has_padding || padding_fits) return {likely, ""};
  }
  std::ostringstream note;
  note.precision(10);
  note << "values became float32: by the headers they may be " << allowed.low << " to "
       << allowed.high << ", more than 16 bits hold";
  return {VoxelType::kFloat32, note.str()};
}

void takeDicomVoxelType(const std::vector<DicomValueMap>& maps, bool as_float32, VolumeInfo& info) {
  DicomVoxelType type = dicomVoxelType(maps);
  if (as_float32 && type.type != VoxelType::kFloat32)
    type = {VoxelType::kFloat32, "values became float32, as was asked"};
  info.voxel_type = type.type;
  if (!type.note.empty()) info.notes.push_back(std::move(type.note));
  noteValueMaps(maps, info.notes);
}

}  // namespace isobrick
