// The grid of a volume as headers of files have it (dims, spacing, origin, direction, length_unit),
// and which grids can be used.
#pragma once

#include <cmath>
#include <cstdint>

#include "isobrick/storage/grid.h"

namespace isobrick {

template <typename Header>
void storeGrid(const Index3& voxels, const GridGeometry& geometry, Header& header) {
  for (int axis = 0; axis < 3; ++axis) {
    header.dims[axis] = static_cast<std::uint64_t>(voxels[axis]);
    header.spacing[axis] = geometry.spacing[axis];
    header.origin[axis] = geometry.origin[axis];
    for (int row = 0; row < 3; ++row)
      header.direction[3 * axis + row] = geometry.direction[axis][row];
  }
  header.length_unit = static_cast<std::uint32_t>(geometry.unit);
}

// False if any of these numbers cannot be. The geometry may be unusable all the same.
template <typename Header>
bool isStoredGridSane(const Header& header) {
  bool sane = header.length_unit <= static_cast<std::uint32_t>(LengthUnit::kMillimetre);
  for (int axis = 0; axis < 3; ++axis)
    sane = sane && header.dims[axis] >= 2 &&
           header.dims[axis] <= static_cast<std::uint64_t>(kMaxVoxelsPerAxis) &&
           std::isfinite(header.spacing[axis]) && header.spacing[axis] > 0 &&
           std::isfinite(header.origin[axis]);
  for (const double d : header.direction) sane = sane && std::isfinite(d);
  return sane;
}

// For a header that is sane.
template <typename Header>
void readGrid(const Header& header, Index3& voxels, GridGeometry& geometry) {
  for (int axis = 0; axis < 3; ++axis) {
    voxels[axis] = static_cast<std::int64_t>(header.dims[axis]);
    geometry.spacing[axis] = header.spacing[axis];
    geometry.origin[axis] = header.origin[axis];
    for (int row = 0; row < 3; ++row)
      geometry.direction[axis][row] = header.direction[3 * axis + row];
  }
  geometry.unit = static_cast<LengthUnit>(header.length_unit);
}

// True if every point of a volume of up to kMaxVoxelsPerAxis voxels an axis gets a position that is
// finite, in single precision too, and world and index space can be changed into each other:
// spacings within 2^-100 .. 2^100, an origin within 2^100, directions that span space.
inline bool isUsableGeometry(const GridGeometry& geometry) {
  constexpr double kMost = 0x1p100;
  bool usable = std::abs(glm::determinant(geometry.direction)) > 1e-6;
  for (int axis = 0; axis < 3; ++axis) {
    usable = usable && geometry.spacing[axis] >= 1 / kMost && geometry.spacing[axis] <= kMost &&
             std::abs(geometry.origin[axis]) <= kMost;
    for (int row = 0; row < 3; ++row)
      usable = usable && std::abs(geometry.direction[axis][row]) <= 2;
  }
  return usable;
}

}  // namespace isobrick
