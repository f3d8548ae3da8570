#include "isobrick/storage/stored_spec.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "isobrick/storage/brick_table.h"
#include "isobrick/storage/stored_grid.h"
#include "isobrick/storage/voxel_type.h"

namespace isobrick {

bool isPowerOfTwoWithin(std::uint32_t value, std::uint32_t least, std::uint32_t greatest) {
  return std::has_single_bit(value) && value >= least && value <= greatest;
}

namespace {

bool areKindsSane(const format::Header& header) {
  if (header.kind_count < 2 || header.kind_count > format::kMostKinds) return false;
  for (std::uint32_t i = 1; i < header.kind_count; ++i)
    if (header.kinds[i] <= header.kinds[i - 1]) return false;
  return header.kinds[0] == kindNumber(PartKind::kSamples) &&
         header.kinds[1] == kindNumber(PartKind::kRanges);
}

// True if a voxel of the type may have the value.
bool isVoxel(VoxelType type, double value) {
  return visitVoxelType(type, [&](auto tag) {
    using T = typename decltype(tag)::Type;
    using Limits = std::numeric_limits<T>;
    return value >= static_cast<double>(Limits::lowest()) &&
           value <= static_cast<double>(Limits::max()) &&
           static_cast<double>(static_cast<T>(value)) == value;
  });
}

// For a header whose voxel type is one of the five.
bool areValuesSane(const format::Header& header) {
  const auto type = static_cast<VoxelType>(header.voxel_type);
  if (!isVoxel(type, header.value_min) || !isVoxel(type, header.value_max) ||
      header.value_min > header.value_max)
    return false;
  // Noise is the median of second differences, less a factor; twice the range bounds it.
  return header.noise >= 0 && header.noise <= 2 * (header.value_max - header.value_min);
}

// Some voxels have no data, and not all.
bool isMissingSane(const format::Header& header) {
  std::uint64_t voxels = 1;
  for (const std::uint64_t n : header.dims) voxels *= n;  // at most 2^60
  return header.voxel_type == static_cast<std::uint32_t>(VoxelType::kFloat32) &&
         header.missing_voxels < voxels && header.super_cells == 0;
}

bool hasKind(const format::Header& header, PartKind kind) {
  const auto* const end = header.kinds + header.kind_count;
  return std::find(header.kinds, end, kindNumber(kind)) != end;
}

}  // namespace

std::optional<PyramidSpec> storedSpec(const format::Header& header) {
  PyramidSpec spec;
  if (header.version >= format::kVersionOfTransforms) {
    spec.values = {header.value_scale, header.value_offset};
    spec.has_missing = header.missing_voxels > 0;
  }
  const bool has_source = header.version >= format::kVersionOfSources;
  if (has_source) spec.level0 = static_cast<Level0Place>(header.level0_place);
  const bool sane =
      spec.values.isSane() && header.voxel_type < kVoxelTypeCount && header.filter <= 1 &&
      areKindsSane(header) && isPowerOfTwoWithin(header.brick_cells, 4, 256) &&
      isPowerOfTwoWithin(header.tile_cells, 2, header.brick_cells) && areValuesSane(header) &&
      std::isfinite(header.curvature_epsilon) && header.curvature_epsilon >= 0 &&
      isStoredGridSane(header) && (!spec.has_missing || isMissingSane(header)) &&
      (!has_source || header.level0_place == static_cast<std::uint32_t>(Level0Place::kInFiles) ||
       header.level0_place == static_cast<std::uint32_t>(Level0Place::kBehindUrl));
  if (!sane) return std::nullopt;
  readGrid(header, spec.voxels, spec.geometry);
  spec.voxel_type = static_cast<VoxelType>(header.voxel_type);
  spec.filter = static_cast<format::Filter>(header.filter);
  spec.brick_cells = header.brick_cells;
  spec.tile_cells = header.tile_cells;
  spec.has_curvature = hasKind(header, PartKind::kCurvature);
  spec.curvature_epsilon = header.curvature_epsilon;
  return spec;
}

}  // namespace isobrick
