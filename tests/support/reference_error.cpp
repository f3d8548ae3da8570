#include "tests/support/reference_error.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <sstream>
#include <utility>

#include "isobrick/storage/index_loop.h"

namespace isobrick::test {
namespace {

struct Bounds {
  double low = 0, high = 0;
};

// The field of a cell of a level with given corners, at a voxel of its closed box.
class CoarseCell {
 public:
  CoarseCell(const Lattice& lattice, const Index3& cell, int level = 1)
      : lower_(lattice.position(level, cell)), upper_(lattice.position(level, cell + Index3(1))) {}

  IndexBox voxels() const { return {lower_, upper_ - lower_ + Index3(1)}; }
  Index3 corner(int n) const {
    return {n & 1 ? upper_.x : lower_.x, n & 2 ? upper_.y : lower_.y, n & 4 ? upper_.z : lower_.z};
  }
  bool isCorner(const Index3& voxel) const {
    for (int axis = 0; axis < 3; ++axis)
      if (voxel[axis] != lower_[axis] && voxel[axis] != upper_[axis]) return false;
    return true;
  }
  bool has(const Index3& voxel) const {
    for (int axis = 0; axis < 3; ++axis)
      if (voxel[axis] < lower_[axis] || voxel[axis] > upper_[axis]) return false;
    return true;
  }
  double interpolate(const std::array<double, 8>& corners, const Index3& voxel) const {
    const glm::dvec3 w = glm::dvec3(voxel - lower_) / glm::dvec3(upper_ - lower_);
    double sum = 0;
    for (int n = 0; n < 8; ++n)
      sum += corners[static_cast<std::size_t>(n)] * (n & 1 ? w.x : 1 - w.x) *
             (n & 2 ? w.y : 1 - w.y) * (n & 4 ? w.z : 1 - w.z);
    return sum;
  }

 private:
  Index3 lower_, upper_;
};

// The greatest |value - isovalue| on an edge where a field between the bounds may be the isovalue.
double crossingError(double isovalue, double value_a, const Bounds& a, double value_b,
                     const Bounds& b) {
  double error = -1;
  if (a.low >= isovalue && b.low >= isovalue) return error;  // inside all along, or touching
  const auto look = [&](double t) {
    if (!(t >= 0 && t <= 1)) return;
    const auto at = [t](double from, double to) { return from + t * (to - from); };
    if (at(a.low, b.low) > isovalue + 1e-9 || at(a.high, b.high) < isovalue - 1e-9) return;
    error = std::max(error, std::abs(at(value_a, value_b) - isovalue));
  };
  look(0);
  look(1);
  look((isovalue - a.low) / (b.low - a.low));
  look((isovalue - a.high) / (b.high - a.high));
  return error;
}

// What a sample of a level may be as the corner of a leaf: rule 6, for any leaves around, coarser
// ones only where `may_hang`.
Bounds cornerBounds(const ReferencePyramid& pyramid, int level, const Index3& position,
                    bool may_hang) {
  const Lattice& lattice = pyramid.lattice;
  const auto own = static_cast<double>(pyramid.sampleAtPosition(level, position));
  const auto finer =
      level == 0 ? own : static_cast<double>(pyramid.sampleAtPosition(level - 1, position));
  Bounds bounds{std::min(own, finer), std::max(own, finer)};
  if (!may_hang || isOnLattice(lattice, level + 1, position)) return bounds;
  // The cell of the next level around it; none on whose corners it hangs where it is inside.
  Index3 cell;
  int inside = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const bool is_on = isOnLattice(lattice, level + 1, axis, position[axis]);
    if (!is_on) ++inside;
    cell[axis] = is_on && position[axis] > 0
                     ? sampleIndex(lattice, level + 1, axis, position[axis]) - 1
                     : position[axis] >> (level + 1);
  }
  if (inside == 3) return bounds;
  const CoarseCell coarse(lattice, cell, level + 1);
  std::array<double, 8> low{}, high{};
  for (int n = 0; n < 8; ++n) {
    const Bounds corner = cornerBounds(pyramid, level + 1, coarse.corner(n), false);
    low[static_cast<std::size_t>(n)] = corner.low;
    high[static_cast<std::size_t>(n)] = corner.high;
  }
  bounds.low = std::min(bounds.low, coarse.interpolate(low, position));
  bounds.high = std::max(bounds.high, coarse.interpolate(high, position));
  return bounds;
}

// The greatest error within the closed cell, whatever its corners are; 0 where nothing is wrong.
double leafError(const ReferencePyramid& pyramid, int level, const Index3& cell, bool may_hang,
                 double isovalue) {
  const CoarseCell leaf(pyramid.lattice, cell, level);
  std::array<double, 8> low{}, high{};
  for (int n = 0; n < 8; ++n) {
    const Bounds corner = cornerBounds(pyramid, level, leaf.corner(n), may_hang);
    low[static_cast<std::size_t>(n)] = corner.low;
    high[static_cast<std::size_t>(n)] = corner.high;
  }
  double error = 0;
  forEachIndex(leaf.voxels(), [&](const Index3& voxel) {
    const auto value = static_cast<double>(pyramid.sampleAt(0, voxel));
    const Bounds bounds{leaf.interpolate(low, voxel), leaf.interpolate(high, voxel)};
    if (value >= isovalue ? bounds.low < isovalue : bounds.high >= isovalue)
      error = std::max(error, std::abs(value - isovalue));
    for (int axis = 0; axis < 3; ++axis) {
      Index3 next = voxel;
      ++next[axis];
      if (!leaf.has(next)) continue;
      error = std::max(
          error,
          crossingError(isovalue, value, bounds, static_cast<double>(pyramid.sampleAt(0, next)),
                        {leaf.interpolate(low, next), leaf.interpolate(high, next)}));
    }
  });
  return error;
}

}  // namespace

std::vector<double> referenceLeafErrors(const ReferencePyramid& pyramid, int level,
                                        double isovalue) {
  const Lattice& lattice = pyramid.lattice;
  const IndexBox cells{Index3(0), lattice.cells(level)};
  std::vector<double> errors;
  if (level == 0) return std::vector<double>(static_cast<std::size_t>(cells.size()), 0.0);
  std::vector<double> finer = referenceLeafErrors(pyramid, level - 1, isovalue);
  const IndexBox finer_cells{Index3(0), lattice.cells(level - 1)};
  std::size_t i = 0;
  forEachIndex(finer_cells, [&](const Index3& cell) {
    finer[i] = std::max(finer[i], leafError(pyramid, level - 1, cell, true, isovalue));
    ++i;
  });
  forEachIndex(cells, [&](const Index3& cell) {
    errors.push_back(leafError(pyramid, level, cell, false, isovalue));
    const Index3 first = glm::max(std::int64_t{2} * cell - Index3(1), Index3(0));
    const Index3 end = glm::min(std::int64_t{2} * cell + Index3(3), finer_cells.count);
    forEachIndex({first, end - first}, [&](const Index3& touching) {
      errors.back() = std::max(
          errors.back(), finer[static_cast<std::size_t>(linearIndex(touching, finer_cells.count))]);
    });
  });
  return errors;
}

namespace {

// What an error is of: edges in the closed cell and its voxels alone, or edges that lead away too.
enum class Extent { kWithin, kAround };

// The error of a cell of level 1 as a leaf, with samples of level 0 at the corners whose bits (x +
// 2y + 4z) are set and samples of either level at the others. Below 0 where nothing crosses.
double cellError(const ReferencePyramid& pyramid, double isovalue, const Index3& cell,
                 unsigned fine_corners, Extent extent) {
  const Lattice& lattice = pyramid.lattice;
  const CoarseCell coarse(lattice, cell);
  std::array<double, 8> low{}, high{};
  for (int n = 0; n < 8; ++n) {
    const auto of_level_0 = static_cast<double>(pyramid.sampleAtPosition(0, coarse.corner(n)));
    const auto of_level_1 =
        (fine_corners >> n & 1) != 0
            ? of_level_0
            : static_cast<double>(pyramid.sampleAtPosition(1, coarse.corner(n)));
    low[static_cast<std::size_t>(n)] = std::min(of_level_0, of_level_1);
    high[static_cast<std::size_t>(n)] = std::max(of_level_0, of_level_1);
  }
  double error = -1;
  forEachIndex(coarse.voxels(), [&](const Index3& voxel) {
    const auto value = static_cast<double>(pyramid.sampleAt(0, voxel));
    const Bounds bounds{coarse.interpolate(low, voxel), coarse.interpolate(high, voxel)};
    if (value >= isovalue ? bounds.low < isovalue : bounds.high >= isovalue)
      error = std::max(error, std::abs(value - isovalue));
    for (int axis = 0; axis < 3; ++axis)
      for (const int step : {-1, 1}) {
        Index3 next = voxel;
        next[axis] += step;
        if (next[axis] < 0 || next[axis] >= lattice.voxels()[axis]) continue;
        const auto next_value = static_cast<double>(pyramid.sampleAt(0, next));
        if (coarse.has(next))
          error = std::max(error, crossingError(isovalue, value, bounds, next_value,
                                                {coarse.interpolate(low, next),
                                                 coarse.interpolate(high, next)}));
        else if (extent == Extent::kAround && !coarse.isCorner(voxel))
          error = std::max(
              error, crossingError(isovalue, value, bounds, next_value, {next_value, next_value}));
      }
  });
  return error;
}

// Whether a box of voxels, as far as there are any, has some inside and some outside.
bool isCrossed(const ReferencePyramid& pyramid, double isovalue, const IndexBox& voxels) {
  const Index3 first = glm::max(voxels.first, Index3(0));
  const Index3 end = glm::min(voxels.end(), pyramid.lattice.voxels());
  bool any_inside = false, any_outside = false;
  forEachIndex({first, end - first}, [&](const Index3& voxel) {
    const bool is_inside = static_cast<double>(pyramid.sampleAt(0, voxel)) >= isovalue;
    any_inside = any_inside || is_inside;
    any_outside = any_outside || !is_inside;
  });
  return any_inside && any_outside;
}

bool isEven(const Index3& cell) { return (cell.x + cell.y + cell.z) % 2 == 0; }

}  // namespace

bool ReferenceTolerance::isBeyond(double error) {
  is_near_ = is_near_ || std::abs(error - tolerance_) <= 2e-3;
  return error > tolerance_;
}

ReferenceTolerance::Kind ReferenceTolerance::kindOf(const Index3& cell) {
  const Lattice& lattice = pyramid_.lattice;
  const auto [known, is_new] =
      kinds_.try_emplace(linearIndex(cell, lattice.cells(1)), Known{Kind::kWithin, false});
  if (is_new) {
    const bool was_near = std::exchange(is_near_, false);
    const IndexBox voxels = CoarseCell(lattice, cell).voxels();
    // Nothing crosses where all values that the samples are made of are on one side.
    if (isCrossed(pyramid_, isovalue_, {voxels.first - Index3(1), voxels.count + Index3(2)}) &&
        isBeyond(cellError(pyramid_, isovalue_, cell, 0, Extent::kAround))) {
      if (!isCrossed(pyramid_, isovalue_, voxels))
        known->second.kind = Kind::kNotCrossed;
      else if (isBeyond(cellError(pyramid_, isovalue_, cell, 0xff, Extent::kWithin)))
        known->second.kind = Kind::kBeyondAmidstFine;
      else
        known->second.kind = Kind::kOpen;
    }
    known->second.is_near = is_near_;
    is_near_ = was_near;
  }
  is_near_ = is_near_ || known->second.is_near;
  return known->second.kind;
}

bool ReferenceTolerance::isOpenBeyond(const Index3& cell, bool beside_even) {
  const IndexBox cells{Index3(0), pyramid_.lattice.cells(1)};
  unsigned fine_corners = 0;
  for (unsigned corner = 0; corner < 8; ++corner)
    forEachIndex({cell - Index3(1) + Index3(corner & 1, corner >> 1 & 1, corner >> 2), Index3(2)},
                 [&](const Index3& touching) {
                   if (touching == cell || !contains(cells, touching)) return;
                   const Kind kind = kindOf(touching);
                   if (kind == Kind::kBeyondAmidstFine ||
                       (beside_even && kind == Kind::kOpen && isEven(touching) &&
                        isOpenBeyond(touching, false)))
                     fine_corners |= 1u << corner;
                 });
  return isBeyond(cellError(pyramid_, isovalue_, cell, fine_corners, Extent::kAround));
}

std::optional<bool> ReferenceTolerance::refines(const Index3& cell) {
  is_near_ = false;
  const Kind kind = kindOf(cell);
  bool is_refined = kind != Kind::kWithin;
  if (kind == Kind::kOpen)
    is_refined = isOpenBeyond(cell, false) && (isEven(cell) || isOpenBeyond(cell, true));
  if (is_near_) return std::nullopt;
  return is_refined;
}

std::string brokenPromise(const ReferencePyramid& pyramid, const ReferenceMesh& mesh,
                          double isovalue, double tolerance) {
  constexpr double kRounding = 1e-3;  // of single precision, for values of some hundreds
  std::ostringstream wrong;
  for (const ReferenceCrossing& crossing : mesh.crossings) {
    const auto valueAt = [&](std::int64_t along) {
      Index3 voxel = crossing.base;
      voxel[crossing.axis] = along;
      return static_cast<double>(pyramid.sampleAt(0, voxel));
    };
    const std::int64_t first = crossing.base[crossing.axis];
    double steepest = 0;
    for (std::int64_t i = first; i < crossing.upper; ++i)
      steepest = std::max(steepest, std::abs(valueAt(i + 1) - valueAt(i)));
    const auto below = std::min(static_cast<std::int64_t>(crossing.position), crossing.upper - 1);
    const double t = crossing.position - static_cast<double>(below);
    const double value = valueAt(below) + t * (valueAt(below + 1) - valueAt(below));
    const double moved = static_cast<double>(crossing.upper - first) * (0x1p-12 + 0x1p-16);
    if (std::abs(value - isovalue) > tolerance + moved * steepest + kRounding)
      wrong << "a vertex at " << crossing.point().x << "," << crossing.point().y << ","
            << crossing.point().z << " lies where level 0 has " << value << "\n";
  }
  const Lattice& lattice = pyramid.lattice;
  std::vector<CoarseCell> cells;
  std::vector<Index3> corners;
  const auto sideOf = [&](const Index3& voxel, double field) {
    const auto value = static_cast<double>(pyramid.sampleAt(0, voxel));
    if ((value >= isovalue + tolerance && field < isovalue - kRounding) ||
        (value < isovalue && value <= isovalue - tolerance && field > isovalue + kRounding))
      wrong << "voxel " << voxel.x << "," << voxel.y << "," << voxel.z << " has " << value
            << " and lies on the side of " << field << "\n";
  };
  forEachIndex({Index3(0), lattice.cells(0)}, [&](const Index3& cell) {
    const int level = mesh.leaves.leafLevelAt(cell);
    const std::int64_t step = std::int64_t{1} << level;
    if (level > 0 && cell % step == Index3(0)) {
      cells.emplace_back(lattice, cell / step, level);
      for (int n = 0; n < 8; ++n) corners.push_back(cells.back().corner(n));
    }
  });
  std::vector<Index3> voxels;  // of leaves of level 0
  forEachIndex({Index3(0), lattice.cells(0)}, [&](const Index3& cell) {
    if (mesh.leaves.leafLevelAt(cell) == 0)
      for (int n = 0; n < 8; ++n) voxels.push_back(cell + Index3(n & 1, n >> 1 & 1, n >> 2));
  });
  const std::vector<float> fine_values = referenceValues(pyramid, mesh.leaves, voxels);
  for (std::size_t i = 0; i < voxels.size(); ++i)
    sideOf(voxels[i], static_cast<double>(fine_values[i]));
  const std::vector<float> corner_values = referenceValues(pyramid, mesh.leaves, corners);
  for (std::size_t i = 0; i < cells.size(); ++i) {
    std::array<double, 8> values{};
    for (std::size_t n = 0; n < 8; ++n) values[n] = static_cast<double>(corner_values[8 * i + n]);
    forEachIndex(cells[i].voxels(),
                 [&](const Index3& voxel) { sideOf(voxel, cells[i].interpolate(values, voxel)); });
  }
  return wrong.str();
}

}  // namespace isobrick::test
