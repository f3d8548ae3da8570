// What the row of a brick may say of its parts. Rows from files are hostile; one place knows
// what is possible, for finished pyramids and for those that a killed build left.
#pragma once

#include "isobrick/storage/pyramid_info.h"

namespace isobrick {

enum class PartKind { kSamples = 0, kRanges = 1, kCurvature = 2 };

inline const format::PartEntry& partOf(const format::BrickRow& row, PartKind kind) {
  return kind == PartKind::kSamples  ? row.samples
         : kind == PartKind::kRanges ? row.ranges
                                     : row.curvature;
}

// Bytes of the elements of a part, unpacked, as the layout gives them; `layout` is spec.layout().
std::uint64_t partBytes(const PyramidSpec& spec, const BrickLayout& layout, PartKind kind,
                        int level, const Index3& brick);

// True where codecs, sizes and alignment of all parts, and the constant, are such as this brick can
// have. Where the bytes lie, and the range of the brick, are for the caller to check.
bool isPossibleRow(const format::BrickRow& row, const PyramidSpec& spec, const BrickLayout& layout,
                   int level, const Index3& brick);

// isPossibleRow() for one part, and for the constant alone.
bool isPossiblePart(const format::BrickRow& row, const PyramidSpec& spec, const BrickLayout& layout,
                    PartKind kind, int level, const Index3& brick);
bool isPossibleConstant(float constant, VoxelType type);

}  // namespace isobrick
