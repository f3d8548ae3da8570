// What oracles share: their answer for many cells at once, and how far cells are from a point.
#pragma once

#include <algorithm>
#include <cmath>

#include "isobrick/storage/brick_layout.h"

namespace isobrick {

// An oracle answers three questions:
//
//   bool refines(int level, const Index3& cell)         is the cell refined, or extracted here?
//   Coverage refinedCoverage(int level, const IndexBox& b)  how many cells of the box are refined?
//   void keepRefined(int level, const Index3& first,    of the cells in a row along x, which are?
//                    std::int64_t count, std::uint64_t* bits)  Clears the bits of the others.
//
// kNone and kAll are certain; kSome may also be the answer for a box that is all of one kind. The
// leaves of an oracle that stands alone are 2:1 balanced (rule 5), and the parent of a cell that it
// refines is refined, so the state of a cell is found without walking down to it. Both hold for
// oracles that are combined too, by the coarser or by the finer one (docs/ALGORITHM.md, section 5).
enum class Coverage { kNone, kSome, kAll };

// The coverage of the cells that two oracles both refine: theirs if the coarser one wins.
inline Coverage coarserCoverage(Coverage a, Coverage b) { return std::min(a, b); }
// The coverage of the cells that one of two refines: theirs if the finer one wins.
inline Coverage finerCoverage(Coverage a, Coverage b) { return std::max(a, b); }

// The smallest box of cells of the next coarser level that covers `cells`, which are not negative.
inline IndexBox parentsOf(const IndexBox& cells) {
  const Index3 first = cells.first / std::int64_t{2};
  const Index3 last = (cells.end() - Index3(1)) / std::int64_t{2};
  return {first, last - first + Index3(1)};
}

// Diagonals of voxel cells are enlarged by a millionth: at the contradiction on which the proof of
// rule 3 ends, both sides can be equal, and rounding must not turn that into a pair of leaves two
// levels apart.
inline constexpr double kDiagonalRoom = 1.0 + 0x1p-20;

// Eq. 1 of the paper solved for the distance: cells of `level` that are closer than this to the
// part of space that is to be finest are refined. `diagonal`: with its room.
inline double refinedWithin(int level, double diagonal) {
  return diagonal * (3.0 * std::ldexp(1.0, level - 1) - 1.0);
}

// The squared distances of the centres of a row's cells along x from a point, in voxels. Cells
// count as full cubes, also at the border, which makes them thin.
class RowDistance {
 public:
  // `first`: cell 0 of the row.
  RowDistance(const glm::dvec3& point, int level, const Index3& first)
      : edge_(static_cast<double>(std::int64_t{1} << level)), x_(point.x), first_(first.x) {
    const double dy = (static_cast<double>(first.y) + 0.5) * edge_ - point.y;
    const double dz = (static_cast<double>(first.z) + 0.5) * edge_ - point.z;
    dy_squared_ = dy * dy;
    dz_squared_ = dz * dz;
  }
  double squared(std::int64_t i) const {
    const double dx = (static_cast<double>(first_ + i) + 0.5) * edge_ - x_;
    return dx * dx + dy_squared_ + dz_squared_;
  }
  // For the line of the cells' centres.
  double squaredBesideX() const { return dy_squared_ + dz_squared_; }
  double edge() const { return edge_; }

 private:
  double edge_, x_, dy_squared_ = 0, dz_squared_ = 0;
  std::int64_t first_;
};

// The same for one cell, to the bit.
inline double squaredDistance(const glm::dvec3& point, int level, const Index3& cell) {
  return RowDistance(point, level, cell).squared(0);
}

// Bounds of that distance for all cells of a box. They are rounded differently, so they are widened
// by a millionth: a distance beyond a bound is so for certain.
struct DistanceBounds {
  double least = 0;
  double greatest = 0;
};
inline DistanceBounds squaredDistanceBounds(const glm::dvec3& point, int level,
                                            const IndexBox& cells) {
  const double edge = static_cast<double>(std::int64_t{1} << level);
  DistanceBounds bounds;
  for (int axis = 0; axis < 3; ++axis) {
    const double low = (static_cast<double>(cells.first[axis]) + 0.5) * edge - point[axis];
    const double high = (static_cast<double>(cells.end()[axis]) - 0.5) * edge - point[axis];
    // No branches: which side the point is on changes from call to call.
    const double near = std::max(std::max(low, -high), 0.0);
    const double far = std::max(-low, high);
    bounds.least += near * near;
    bounds.greatest += far * far;
  }
  bounds.least *= 1 - 1e-6;
  bounds.greatest *= 1 + 1e-6;
  return bounds;
}

}  // namespace isobrick
