// The entry of a brick in the brick table: its parts, and their possible values. Rows from files
// are hostile; the checks here serve finished pyramids and those that a killed build left.
#pragma once

#include <array>

#include "isobrick/storage/format.h"
#include "isobrick/storage/pyramid_info.h"

namespace isobrick {

enum class PartKind { kSamples, kRanges, kCurvature };
inline constexpr std::array kPartKinds = {PartKind::kSamples, PartKind::kRanges,
                                          PartKind::kCurvature};
// "samples", "ranges" or "curvature".
constexpr const char* partName(PartKind kind) {
  constexpr const char* kNames[] = {"samples", "ranges", "curvature"};
  return kNames[static_cast<std::size_t>(kind)];
}

// The kind's number in the file's header; those of others are passed over.
constexpr std::uint32_t kindNumber(PartKind kind) {
  constexpr std::uint32_t kPartNumbers[] = {0, 1, 4};
  return kPartNumbers[static_cast<std::size_t>(kind)];
}

// A row of the brick table, with an entry for every kind that this program reads; parts that the
// file does not have are absent.
struct BrickRow {
  std::array<format::PartEntry, kPartKinds.size()> parts;
  float range_min = 0, range_max = 0;
  float constant = 0;
  std::uint32_t unused = 0;  // journals have no padding

  const format::PartEntry& part(PartKind kind) const {
    return parts[static_cast<std::size_t>(kind)];
  }
  format::PartEntry& part(PartKind kind) { return parts[static_cast<std::size_t>(kind)]; }
};

// Bytes of the elements of a part, unpacked, as the layout gives them; `layout` is spec.layout().
std::uint64_t partBytes(const PyramidSpec& spec, const BrickLayout& layout, PartKind kind,
                        int level, const Index3& brick);

// True if codecs, sizes and alignment of all parts, and the constant, are possible for this brick.
// The caller checks the place of the bytes and the range of the brick.
bool isPossibleRow(const BrickRow& row, const PyramidSpec& spec, const BrickLayout& layout,
                   int level, const Index3& brick);

// isPossibleRow() for one part, and for the constant alone.
bool isPossiblePart(const BrickRow& row, const PyramidSpec& spec, const BrickLayout& layout,
                    PartKind kind, int level, const Index3& brick);
bool isPossibleConstant(float constant, const PyramidSpec& spec);

}  // namespace isobrick
