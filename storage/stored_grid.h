// The grid of a volume as headers of files have it: dims, spacing, origin, direction, length_unit.
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

}  // namespace isobrick
