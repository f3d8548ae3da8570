#include "isobrick/storage/brick_table.h"

#include <cmath>
#include <limits>

#include "isobrick/storage/brick_encoder.h"
#include "isobrick/storage/deviation_code.h"

namespace isobrick {

std::uint64_t partBytes(const PyramidSpec& spec, const BrickLayout& layout, PartKind kind,
                        int level, const Index3& brick) {
  switch (kind) {
    case PartKind::kSamples:
      return static_cast<std::uint64_t>(layout.brickSampleBox(level, brick).size()) *
             voxelBytes(spec.voxel_type);
    case PartKind::kRanges:
      return static_cast<std::uint64_t>(elementCount(layout.brickTiles(level, brick))) * 2 *
             voxelBytes(spec.voxel_type);
    case PartKind::kCurvature:
      return static_cast<std::uint64_t>(elementCount(layout.brickCurvatureBlocks(brick))) *
             kDeviationCoefficients;
  }
  return 0;
}

namespace {

// Curvature: of level 0 alone, and of none of its bricks that have nothing to gain by it.
bool mayBeAbsent(PartKind kind) { return kind == PartKind::kCurvature; }
bool mayBeStored(PartKind kind, const PyramidSpec& spec, int level) {
  return kind != PartKind::kCurvature || (level == 0 && spec.has_curvature);
}

}  // namespace

bool isPossiblePart(const BrickRow& row, const PyramidSpec& spec, const BrickLayout& layout,
                    PartKind kind, int level, const Index3& brick) {
  const format::PartEntry& part = row.part(kind);
  const bool may_be_stored = mayBeStored(kind, spec, level);
  const auto codec = static_cast<format::Codec>(part.codec);
  switch (codec) {
    case format::Codec::kConstant:
    case format::Codec::kAbsent:
      // Constant ranges are those of constant samples.
      return (codec == format::Codec::kAbsent ? mayBeAbsent(kind) : may_be_stored) &&
             part.stored_bytes == 0 && part.offset == 0 &&
             (kind != PartKind::kRanges || row.part(PartKind::kSamples).codec == part.codec);
    case format::Codec::kStored:
    case format::Codec::kLz4:
    case format::Codec::kZstd: {
      const std::uint64_t elements = partBytes(spec, layout, kind, level, brick);
      const bool is_size_right = codec == format::Codec::kStored
                                     ? part.stored_bytes == elements
                                     : part.stored_bytes > 0 && part.stored_bytes < elements &&
                                           elements <= kMostPackedBytes;
      return may_be_stored && is_size_right && part.offset % format::kPartAlignment == 0;
    }
    case format::Codec::kInSource:
      return kind == PartKind::kSamples && level == 0 && spec.level0 != Level0Place::kStored &&
             part.stored_bytes == partBytes(spec, layout, kind, level, brick) && part.offset == 0;
  }
  return false;
}

bool isPossibleConstant(float constant, const PyramidSpec& spec) {
  if (std::isnan(constant)) return spec.has_missing;
  return visitVoxelType(spec.voxel_type, [&](auto tag) {
    using T = typename decltype(tag)::Type;
    return constant >= static_cast<float>(std::numeric_limits<T>::lowest()) &&
           constant <= static_cast<float>(std::numeric_limits<T>::max());
  });
}

bool isPossibleRow(const BrickRow& row, const PyramidSpec& spec, const BrickLayout& layout,
                   int level, const Index3& brick) {
  for (const PartKind kind : kPartKinds)
    if (!isPossiblePart(row, spec, layout, kind, level, brick)) return false;
  return isPossibleConstant(row.constant, spec);
}

}  // namespace isobrick
