// Which cells of rows along x have their centres in a sphere.
#pragma once

#include <array>
#include <glm/vec3.hpp>

#include "isobrick/storage/grid.h"

namespace isobrick {

// A run of cells in a row, counted from the row's first; empty if it ends where it begins or
// before.
struct CellSpan {
  std::int64_t begin, end;
};

// Up to eight rows that follow each other along y. Lengths are in voxels.
struct SphereRows {
  static constexpr std::size_t kMost = 8;

  glm::dvec3 center{0.0};
  double within_squared = 0;  // closer centres are in
  double edge = 1;            // of a cell: a power of two
  Index3 first{0};            // cell 0 of the first row
  std::int64_t count = 0;     // cells of a row

  // By cut(): whole numbers in 0 .. count, and whether they are certain: the ends of the sphere are
  // computed by a square root, and near the centre of a cell rounding might decide.
  alignas(64) std::array<double, kMost> begin, end, is_certain;

  void cut();
  CellSpan span(std::size_t row) const {
    return {static_cast<std::int64_t>(begin[row]), static_cast<std::int64_t>(end[row])};
  }
};

}  // namespace isobrick
